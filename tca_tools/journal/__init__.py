"""A run: its journal files, its records, and what was known at any instant."""
