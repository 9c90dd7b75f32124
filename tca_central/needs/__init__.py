"""The graph of waits over handlers, messages, resources, claims and points of tasks."""
