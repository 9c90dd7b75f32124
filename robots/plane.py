"""Places on a plane, as whoever stands there sees them and as the world has them."""

import math


def placed(x: float, y: float, heading: float, ahead: float, left: float) -> tuple[float, float]:
    """The place in the world of what is so far *ahead* and to the *left* of one who stands there."""
    cos, sin = math.cos(heading), math.sin(heading)
    return x + cos * ahead - sin * left, y + sin * ahead + cos * left


def seen_from(x: float, y: float, heading: float, place_x: float, place_y: float) -> tuple[float, float]:
    """How far ahead and to the left a place of the world is for one who stands there."""
    cos, sin = math.cos(heading), math.sin(heading)
    dx, dy = place_x - x, place_y - y
    return cos * dx + sin * dy, cos * dy - sin * dx
