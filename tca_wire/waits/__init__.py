"""Waits: their kinds, one wait as data, and the walk to their ends."""

from tca_wire.waits.kinds import CommonEnd, Waiter, WaitFor, WaitKind

__all__ = ["CommonEnd", "WaitFor", "WaitKind", "Waiter"]
