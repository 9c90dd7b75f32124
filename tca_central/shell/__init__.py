"""What touches the world: the socket, the journal's files, the pulses of processes."""
