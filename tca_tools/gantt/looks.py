"""How a chart looks: a colour for each message, sizes and styles."""

import colorsys
from pathlib import Path

from tca_tools.drawing import svg
from tca_tools.gantt.chart import ResourceRow
from tca_tools.terminal import cut
from tca_wire.text.printable import printable

MARGIN = 24.0
CHARACTER = 6.5
"""Mean width of a character of the labels; a guess that must not be too small."""
LONGEST_LABEL = 40
_WIDEST = 1.2
"""How much wider than usual letters are where a machine has none of the fonts that are asked
for.
"""
OWN_STYLE = Path(__file__).with_name("chart.css").read_text()
STYLE = svg.STYLE + OWN_STYLE

_DARK = (  # none is red: that means a failure
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
    red, green, blue = colorsys.hls_to_rgb(
        _FIRST_HUE + _HUES * (number * _GOLDEN_ANGLE % 1.0), 0.38, 0.45
    )
    return f"#{round(red * 255):02x}{round(green * 255):02x}{round(blue * 255):02x}"


def light(number: int) -> str:
    """The dark colour, mixed with white."""
    channels = (int(dark(number)[place : place + 2], 16) for place in (1, 3, 5))
    return "#" + "".join(f"{round(channel + (255 - channel) * _TINT):02x}" for channel in channels)


def row_label(row: ResourceRow) -> str:
    """The row's name as it is shown."""
    return cut(printable(row.label), LONGEST_LABEL)


def label_room(row: ResourceRow) -> float:
    """How many pixels its name needs at most: nothing scrolls to what is cut off there."""
    return svg.width_of(row_label(row)) * _WIDEST
