"""Central's answers about itself. This changes no state."""
