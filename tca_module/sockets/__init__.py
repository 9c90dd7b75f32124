"""All uses of ZeroMQ in the library: sockets to central, between modules, and the pulse."""
