"""What a handler or script does: send, order, wait, steer other tasks."""
