"""The daemon: a pure, deterministic core and one ZeroMQ shell around it."""

from tca_central import loading as loading
