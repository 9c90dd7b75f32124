"""Durations, counts, lists and numbered things in words: one form each, everywhere."""

from collections.abc import Sequence
from math import inf

_MOST_NAMES = 3
"""The number of names that a list shows; further names are only counted."""


def duration(seconds: float) -> str:
    """Return ``742 µs``, ``12.3 ms``, ``1.5 s``, ``12:05 min`` or ``33:09:06 h``."""
    if not seconds < inf:  # infinite, or not a number
        return f"{seconds} s"
    if seconds < 5e-7:
        return "0 s"
    for unit, size in (("µs", 1e-6), ("ms", 1e-3)):
        if seconds < 999.5 * size:
            return f"{seconds / size:.3g} {unit}"
    if seconds < 119.5:
        return f"{seconds:.3g} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 120:
        return f"{minutes}:{rest:02} min"
    return f"{minutes // 60}:{minutes % 60:02}:{rest:02} h"


def run_time(seconds: float) -> str:
    """Return a time of the run, in seconds since its start: ``12.300 s``."""
    return f"{seconds:.3f} s" if seconds < 10_000 else f"{seconds:.1f} s"


def from_to(start: float, end: float | None) -> str:
    """Return a span: ``from 0.700 s to 1.400 s``, or without an end ``from 0.700 s on``."""
    until = "on" if end is None else f"to {run_time(end)}"
    return f"from {run_time(start)} {until}"


def percent(share: float) -> str:
    """Return ``62%``, ``4.1%``."""
    return f"{share:.0%}" if share >= 0.0995 else f"{share:.1%}"


def size(octets: float) -> str:
    """Return ``812 bytes``, ``1.5 KiB``, ``320 MiB``."""
    if octets < 1 << 10:
        return f"{octets:.0f} bytes"
    for unit in ("KiB", "MiB", "GiB"):
        octets /= 1024
        if octets < 1000:
            return f"{octets:.3g} {unit}"
    return f"{octets / 1024:.3g} TiB"


def times(number: int) -> str:
    """Return ``once``, ``twice``, ``3 times``."""
    return {1: "once", 2: "twice"}.get(number, f"{number:,} times")


def counted(number: int, noun: str) -> str:
    """Return ``1 task``, ``2 tasks``, ``12,000 tasks``."""
    return f"{number:,} {noun}{'s' * (number != 1)}"


def listed(names: Sequence[str], more: int = 0, *, named: int = _MOST_NAMES) -> str:
    """Return ``a``, ``a and b``, ``a, b and c``, or ``a, b, c and 52 more``.

    Only the first *named* names are shown; *more* counts names that are not given at all.
    """
    more += max(len(names) - named, 0)
    parts = [*names[:named], *([f"{more:,} more"] if more else [])]
    return f"{', '.join(parts[:-1])} and {parts[-1]}" if len(parts) > 1 else "".join(parts)


def ordinal(number: int) -> str:
    """Return ``1st``, ``2nd``, ``3rd``, ``11th``."""
    ending = {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number:,}{'th' if 10 < number % 100 < 14 else ending}"


def numbered(name: str, number: int) -> str:
    """Return a task, message or lock: ``grip {24}``."""
    return f"{name} {{{number}}}" if number else name
