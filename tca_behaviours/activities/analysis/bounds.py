"""Bounds of utilisation, shown beside the analysis: for preemptive processors whose activities have one period each."""

import math
from collections.abc import Iterable


def liu_layland(number: int) -> float:
    """So many processors with rate-monotonic priorities are schedulable if they use no more than this."""
    return number * (2 ** (1 / number) - 1) if number else 1.0


def is_hyperbolic(utilisations: Iterable[float]) -> bool:
    """Whether processors that use so much each are schedulable by the hyperbolic bound, which accepts more."""
    return math.prod(1 + each for each in utilisations) <= 2
