"""Questions asked of a whole run, one a file: pure functions of its records."""
