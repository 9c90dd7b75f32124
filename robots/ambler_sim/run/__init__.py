"""A whole walk: its programs, its faults, its figures."""
