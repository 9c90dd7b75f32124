"""Handling messages: handlers, servers, callbacks, and the threads that run them."""
