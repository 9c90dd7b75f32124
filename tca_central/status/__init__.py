"""What central tells about itself. Changes nothing."""
