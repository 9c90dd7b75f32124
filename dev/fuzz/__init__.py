"""Hostile bytes for everything that reads bytes from others: docs/fuzzing.md."""
