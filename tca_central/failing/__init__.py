"""Failures, and the exception handlers that deal with them."""
