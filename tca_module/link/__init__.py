"""One connection to central: sockets, packets, requests and their answers."""
