"""Places on a plane, as whoever stands there sees them and as the world has them."""

import math
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:  # most robots need no numpy
    import numpy as np
    from numpy.typing import NDArray

Number = TypeVar("Number", float, "NDArray[np.float64]")
"""A coordinate, or those of many places."""


def placed(
    x: float, y: float, heading: float, ahead: Number, left: Number
) -> tuple[Number, Number]:
    """The place in the world of what is so far *ahead* and to the *left* of one who stands
    there.
    """
    cos, sin = math.cos(heading), math.sin(heading)
    return x + cos * ahead - sin * left, y + sin * ahead + cos * left


def seen_from(
    x: float, y: float, heading: float, place_x: Number, place_y: Number
) -> tuple[Number, Number]:
    """How far ahead and to the left a place of the world is for one who stands there."""
    cos, sin = math.cos(heading), math.sin(heading)
    dx, dy = place_x - x, place_y - y
    return cos * dx + sin * dy, cos * dy - sin * dx
