"""The calls of a handler or script: send, order, wait, steer other tasks."""
