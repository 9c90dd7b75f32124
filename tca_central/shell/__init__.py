"""The outside of central: the socket, the journal's files, the pulses of processes."""
