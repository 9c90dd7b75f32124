"""The order of events: constraints, the agenda of tasks to advance, and the queues for slots."""
