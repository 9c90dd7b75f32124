"""A module at work: threads, handlers, callbacks, coroutines."""
