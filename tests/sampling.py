"""Of very many combinations the suite tries some, and the soak all."""

from collections.abc import Iterable
from itertools import product
from typing import Any

import pytest

in_the_soak = False
"""Whether new lives are wanted, and many: set before tests are collected."""


def lives(usual: int, soak: int) -> int:
    """How many random lives are tried, or how long they are: more in the soak."""
    return soak if in_the_soak else usual


def one_in(number: int, first: Iterable[str], second: Iterable[str]) -> list[Any]:
    """All pairs of two lists, as parameters; all but one in so many are of the soak. Each of either
    list is among those that are not, if neither has fewer than *number*.
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
