"""The commands that talk to a running central: ask, send, steer, watch."""
