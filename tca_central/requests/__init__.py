"""Requests of modules: a function for each message."""
