"""How a module handles messages: threads, handlers, callbacks, coroutines."""
