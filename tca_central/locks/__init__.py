"""Locks and reservations of resources."""
