"""Sampling of many combinations. The suite tries some of them, the soak all."""

from collections.abc import Iterable
from itertools import product
from typing import Any

import pytest

in_the_soak = False
"""Whether new and more random examples are wanted. It is set before collection."""


def lives(usual: int, soak: int) -> int:
    """Return the number or length of random examples: *soak* in the soak, otherwise *usual*."""
    return soak if in_the_soak else usual


def every(number: int, items: Iterable[Any]) -> list[Any]:
    """Return all items, as parameters. Outside the soak, only every *number*-th runs, from the first.

    A tuple holds the values of several parameters.
    """
    return [
        pytest.param(
            *(item if isinstance(item, tuple) else (item,)),
            marks=[pytest.mark.soak] if at % number else [],
        )
        for at, item in enumerate(items)
    ]


def one_in(number: int, first: Iterable[str], second: Iterable[str]) -> list[Any]:
    """Return all pairs of two lists, as parameters. Outside the soak, only one pair in *number*
    runs.

    The pairs that run include each item of both lists, if neither list is shorter than *number*.
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
