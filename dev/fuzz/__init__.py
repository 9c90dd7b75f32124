"""Hostile bytes for all code that reads bytes from others: dev/records/fuzzing.md."""
