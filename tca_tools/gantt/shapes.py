"""What the parts of a chart's SVG have in common: sizes, looks and labels."""

from tca_tools.drawing import svg as drawing
from tca_tools.gantt.parts import Row
from tca_tools.terminal import cut
from tca_wire.text.printable import printable

MARGIN = 24.0
CHARACTER = 6.5
"""Mean width of a character of the labels; a guess that must not be too small."""
LONGEST_LABEL = 40
_WIDEST = 1.2
"""How much wider than usual letters are where a machine has none of the fonts that are asked for."""
FAILED, COPED = "#c81e1e", "#d08a00"
"""The colours of what failed, and of what did though the run went on."""
KILLED = "#10161d"
"""The colour of the end of what was killed."""
OWN_STYLE = f"""\
.on {{ fill: #ffffff; font-size: 11px; }} .connected {{ fill: #f1f3f5; }} .in {{ font-size: 11px; }}
.failed {{ fill: none; stroke: {FAILED}; stroke-width: 2; }} .coped {{ fill: none; stroke: {COPED}; stroke-width: 2; }}
.number {{ fill: #3e4c59; font-size: 11px; }}
.number {{ stroke: #f1f3f5; stroke-width: 4px; stroke-linejoin: round; paint-order: stroke; }}
.before {{ text-anchor: end; }} .after {{ text-anchor: start; }}
.killed {{ stroke: {KILLED}; stroke-width: 3; }}
.label {{ text-anchor: end; }} .beside {{ opacity: 0.4; }}
.locked {{ fill: #f6c9c5; }} .reserved {{ fill: #f9e3b4; }}"""
STYLE = drawing.STYLE + OWN_STYLE


def row_label(row: Row) -> str:
    """The row's name as it is shown."""
    return cut(printable(row.label), LONGEST_LABEL)


def label_room(row: Row) -> float:
    """How many pixels its name needs at most: nothing scrolls to what is cut off there."""
    return drawing.width_of(row_label(row)) * _WIDEST
