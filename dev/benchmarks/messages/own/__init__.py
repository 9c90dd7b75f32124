"""The contestants without other programs: ZeroMQ alone, and central."""
