"""All of the library that knows ZeroMQ: to central, between modules, and the pulse."""
