"""Explain why tasks wait, and their outcomes."""
