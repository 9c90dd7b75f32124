"""The coordinator: runs a machine with a preview, as a task."""
