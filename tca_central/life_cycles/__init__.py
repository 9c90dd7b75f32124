"""The states of tasks: changes, observers, and tasks whose handler is busy."""
