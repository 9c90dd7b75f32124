"""What waits for what: one graph over handlers, messages, resources, claims and points of tasks."""
