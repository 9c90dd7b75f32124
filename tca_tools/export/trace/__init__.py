"""A run as a Perfetto trace: its tracks with their events, and the file format."""
