"""A whole walk: its programs, the programs lost on the way, its rules and its figures."""
