"""Following tasks: a local copy of a task's state, its changes, and the requests of clients."""
