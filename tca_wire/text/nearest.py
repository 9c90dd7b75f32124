"""Advice for an unknown name, for the end of an error."""

from collections.abc import Iterable
from difflib import get_close_matches

from tca_wire.text.printable import printable


def nearest(name: str, known: Iterable[str]) -> str:
    """Return the nearest known name; "" if none is near."""
    return next(iter(get_close_matches(name, sorted(known), n=1)), "")


def did_you_mean(name: str, known: Iterable[str], lead: str = "") -> str:
    """Return a question for the nearest known name, after *lead*; "" if none is near."""
    found = nearest(name, known)
    return f"{lead}did you mean '{printable(found)}'?" if found else ""


def nearest_or_all(name: str, known: Iterable[str], otherwise: str = "there are") -> str:
    """Return a question for the nearest known name; all known names if none is near."""
    names = sorted(known)
    return did_you_mean(name, names) or f"{otherwise} {', '.join(map(printable, names)) or 'none'}"
