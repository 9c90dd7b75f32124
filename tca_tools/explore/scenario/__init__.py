"""Scenarios as users write them, and how their scripts run."""
