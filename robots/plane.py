"""Places on a plane, in the frame of an observer who stands on it and in the world's frame."""

import math
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:  # most robots need no numpy
    import numpy as np
    from numpy.typing import NDArray

Number = TypeVar("Number", float, "NDArray[np.float64]")
"""A coordinate, or those of many places."""


def world_place(
    x: float, y: float, heading: float, ahead: Number, left: Number
) -> tuple[Number, Number]:
    """Return the world coordinates of a place *ahead* and to the *left* of an observer at x, y."""
    cos, sin = math.cos(heading), math.sin(heading)
    return x + cos * ahead - sin * left, y + sin * ahead + cos * left


def seen_from(
    x: float, y: float, heading: float, place_x: Number, place_y: Number
) -> tuple[Number, Number]:
    """Return how far ahead and to the left of an observer at x, y a place of the world is."""
    cos, sin = math.cos(heading), math.sin(heading)
    dx, dy = place_x - x, place_y - y
    return cos * dx + sin * dy, cos * dy - sin * dx
