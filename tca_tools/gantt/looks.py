"""How a chart looks: a colour for each message, those of endings, sizes and styles."""

import colorsys

from tca_tools.drawing import svg
from tca_tools.gantt.chart import Ending, ResourceRow
from tca_tools.terminal import cut
from tca_wire.text.printable import printable

MARGIN = 24.0
CHARACTER = 6.5
"""Mean width of a character of the labels; a guess that must not be too small."""
LONGEST_LABEL = 40
_WIDEST = 1.2
"""How much wider than usual letters are where a machine has none of the fonts that are asked for."""
COLOURS = {
    Ending.FAILED: "#c81e1e",
    Ending.COPED: "#f0a500",
    Ending.RESOLVED: "#bdbb00",
    Ending.KILLED: "#10161d",
    Ending.NONE: "#10161d",
}
"""That of what was handled is brighter than all of messages, of which some are orange or gold."""
AHEAD = "#7ab4f0"
"""What ran ahead of its state, as in figure 7 of the paper."""
OWN_STYLE = f"""\
.on {{ fill: #ffffff; font-size: 11px; }} .connected {{ fill: #f1f3f5; }} .in {{ font-size: 11px; }}
.failed {{ fill: none; stroke: {COLOURS[Ending.FAILED]}; stroke-width: 2; }}
.coped {{ fill: none; stroke: {COLOURS[Ending.COPED]}; stroke-width: 2; }}
.resolved {{ fill: none; stroke: {COLOURS[Ending.RESOLVED]}; stroke-width: 2; }}
.number {{ fill: #3e4c59; font-size: 11px; }}
.number {{ stroke: #f1f3f5; stroke-width: 4px; stroke-linejoin: round; paint-order: stroke; }}
.before {{ text-anchor: end; }} .after {{ text-anchor: start; }}
.killed {{ stroke: {COLOURS[Ending.KILLED]}; stroke-width: 3; }}
.label {{ text-anchor: end; }} .beside {{ opacity: 0.4; }}
.ahead {{ fill: {AHEAD}; stroke: #ffffff; stroke-width: 0.8; }} .wasted {{ fill: url(#wasted); }}
.locked {{ fill: #f6c9c5; }} .reserved {{ fill: #f9e3b4; }}"""
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
    red, green, blue = colorsys.hls_to_rgb(_FIRST_HUE + _HUES * (number * _GOLDEN_ANGLE % 1.0), 0.38, 0.45)
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
