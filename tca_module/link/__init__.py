"""A connection to central: opens it, waits on it, keeps it alive."""
