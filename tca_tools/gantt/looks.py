"""The look of a chart: a colour for each message, sizes and styles."""

import colorsys
from pathlib import Path

from tca_tools.drawing import svg
from tca_tools.gantt.chart import ResourceRow
from tca_tools.terminal import cut
from tca_wire.text.printable import printable

MARGIN = 24.0
CHARACTER = 6.5
"""The mean width of a character in a label, in pixels: an upper estimate."""
LONGEST_LABEL = 40
_FONT_TOLERANCE = 1.2
"""The factor by which letters may be wider if a machine lacks all the fonts of the style."""
OWN_STYLE = Path(__file__).with_name("chart.css").read_text()
STYLE = svg.STYLE + OWN_STYLE

_DARK = (  # without red, which means a failure
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
    """Return the colour of name *number*, dark enough for white text."""
    if number < len(_DARK):
        return _DARK[number]
    red, green, blue = colorsys.hls_to_rgb(
        _FIRST_HUE + _HUES * (number * _GOLDEN_ANGLE % 1.0), 0.38, 0.45
    )
    return f"#{round(red * 255):02x}{round(green * 255):02x}{round(blue * 255):02x}"


def light(number: int) -> str:
    """Return the dark colour of name *number*, mixed with white."""
    channels = (int(dark(number)[place : place + 2], 16) for place in (1, 3, 5))
    return "#" + "".join(f"{round(channel + (255 - channel) * _TINT):02x}" for channel in channels)


def row_label(row: ResourceRow) -> str:
    """Return the row's name as it is shown."""
    return cut(printable(row.label), LONGEST_LABEL)


def label_room(row: ResourceRow) -> float:
    """Return the most pixels that a row's name may need; labels do not scroll."""
    return svg.width_of(row_label(row)) * _FONT_TOLERANCE
