"""A connection's protocol without I/O: requests, repeats, deliveries, redeclaration."""
