"""The graph of waits between handlers, messages, resources, claims and points of tasks."""
