"""Advice for a name that is unknown."""

from collections.abc import Iterable
from difflib import get_close_matches


def did_you_mean(name: str, known: Iterable[str], otherwise: str = "") -> str:
    """The nearest of the *known* names, as a question; *otherwise* if none is near."""
    nearest = get_close_matches(name, list(known), n=1)
    return f"did you mean '{nearest[0]}'?" if nearest else otherwise
