"""Scenarios as users write them, and the runs of their scripts."""
