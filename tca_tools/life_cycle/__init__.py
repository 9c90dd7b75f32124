"""Life cycles of tasks as tables and diagrams."""
