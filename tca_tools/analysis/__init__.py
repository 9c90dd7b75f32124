"""Analyses of a whole run, one per file: pure functions of its records."""
