"""Messages as a robot's vocabulary declares them, and the formats of their data."""
