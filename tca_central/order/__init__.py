"""The order of events: constraints, the agenda of tasks to look at, and the giving of slots."""
