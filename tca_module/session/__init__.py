"""One connection's side of the protocol, in data: no socket, no clock, no thread."""
