"""The coordinator: a machine with a preview, as a task."""
