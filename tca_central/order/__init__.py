"""What may happen next: constraints, the agenda of tasks to look at, and who gets which slot."""
