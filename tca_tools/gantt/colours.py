"""One colour for each message name: dark for handling, light for waiting. None is red: that means a failure."""

import colorsys

_DARK = (
    "#1f6fb2",
    "#c9601d",
    "#2a8a55",
    "#a63d7a",
    "#6f56b8",
    "#9a7b00",
    "#25879b",
    "#3d4a9e",
    "#5f7330",
    "#84563a",
)
_GOLDEN_ANGLE = 0.381966
_FIRST_HUE, _HUES = 0.07, 0.84
"""From orange to purple."""
_TINT = 0.68


def dark(number: int) -> str:
    """The colour of the *number*-th name; white text can be read on it."""
    if number < len(_DARK):
        return _DARK[number]
    red, green, blue = colorsys.hls_to_rgb(_FIRST_HUE + _HUES * (number * _GOLDEN_ANGLE % 1.0), 0.38, 0.45)
    return f"#{round(red * 255):02x}{round(green * 255):02x}{round(blue * 255):02x}"


def light(number: int) -> str:
    """The same colour, mixed with white."""
    channels = (int(dark(number)[place : place + 2], 16) for place in (1, 3, 5))
    return "#" + "".join(f"{round(channel + (255 - channel) * _TINT):02x}" for channel in channels)
