"""The commands for a running central: show its state, send messages, steer and watch tasks."""
