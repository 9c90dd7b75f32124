"""Deadlocks: waits that can never end."""
