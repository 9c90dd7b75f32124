"""Wiretaps, and tasks that are monitors."""
