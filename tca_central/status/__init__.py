"""Central's answers about itself. Changes nothing."""
