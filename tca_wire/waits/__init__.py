"""Waits: their kinds, one wait as data, and the search for their ends."""

from tca_wire.waits.kinds import NAMED, CommonEnd, Waiter, WaitFor, WaitKind, first_ones

__all__ = ["NAMED", "CommonEnd", "WaitFor", "WaitKind", "Waiter", "first_ones"]
