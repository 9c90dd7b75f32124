"""Hostile bytes for all code that reads bytes from others: docs/fuzzing.md."""
