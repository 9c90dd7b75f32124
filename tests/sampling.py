"""Sampling of many combinations: the suite tries some, and the soak all."""

from collections.abc import Iterable
from itertools import product
from typing import Any

import pytest

in_the_soak = False
"""Whether new and more random examples are wanted; set before collection."""


def lives(usual: int, soak: int) -> int:
    """The number, or length, of random examples: larger in the soak."""
    return soak if in_the_soak else usual


def one_in(number: int, first: Iterable[str], second: Iterable[str]) -> list[Any]:
    """All pairs of two lists, as parameters; only one in *number* runs outside the soak.

    They include each item of both lists, if neither is shorter than *number*.
    """
    numbered = product(enumerate(first), enumerate(second))
    return [
        pytest.param(
            one,
            other,
            marks=[pytest.mark.soak] if (row + column) % number else [],
            id=f"{one}-{other}",
        )
        for (row, one), (column, other) in numbered
    ]
