"""The daemon: a pure, deterministic core and one ZeroMQ shell around it."""
