"""Periodic tasks, missions written in Python, and state machines of tasks."""
