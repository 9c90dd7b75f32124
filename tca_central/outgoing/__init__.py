"""Messages that central sends itself: copies for many handlers, its own, notices, routes."""
