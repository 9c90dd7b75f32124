"""The states of tasks: how they change, who observes them, and what becomes of tasks whose handler
is busy.
"""
