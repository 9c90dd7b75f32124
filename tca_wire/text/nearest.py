"""Advice for an unknown name, for the end of an error."""

from collections.abc import Iterable
from difflib import get_close_matches

from tca_wire.text.printable import printable


def did_you_mean(name: str, known: Iterable[str], lead: str = "") -> str:
    """Return a question for the nearest known name, after *lead*; "" if none is near."""
    found = get_close_matches(name, sorted(known), n=1)
    return f"{lead}did you mean '{printable(found[0])}'?" if found else ""


def nearest_or_all(name: str, known: Iterable[str], otherwise: str = "there are") -> str:
    """Return a question for the nearest known name; all known names if none is near."""
    names = sorted(known)
    return did_you_mean(name, names) or f"{otherwise} {', '.join(map(printable, names)) or 'none'}"
