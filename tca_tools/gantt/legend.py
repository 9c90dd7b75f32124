"""The legend of a chart: its colours and hatchings."""

from pathlib import Path

from tca_tools.drawing import svg
from tca_tools.gantt.axis import Scale
from tca_tools.gantt.chart import CONNECTED, CURVE, FLAGGED, MARKED, MEANINGS, BarKind, Chart
from tca_tools.gantt.looks import LONGEST_LABEL, MARGIN, dark
from tca_tools.gantt.queues import is_curve
from tca_tools.terminal import cut
from tca_wire.text.printable import printable

HATCHINGS = Path(__file__).with_name("legend.svg").read_text()
"""The hatchings of the legend's squares, and of wasted work."""
_LINE = 24.0
_MOST_NAMES = 40
"""The most messages in the legend; more colours could not be distinguished."""


def meanings(chart: Chart, scale: Scale) -> list[tuple[str, str]]:
    """Return the squares of the legend (attributes of a ``<rect>``) with their meanings."""
    seen = chart.legend_keys()
    curves = {id(row) for row in chart.rows if is_curve(row, scale)}
    hatched = {bar.kind for row in chart.rows for bar in row.queued if id(row) not in curves}
    seen -= {CONNECTED, *({BarKind.QUEUED, BarKind.SUSPENDED} - hatched)}
    seen |= {CURVE} if curves else set()
    seen |= {f"flag-{one}" for one in FLAGGED if not seen.isdisjoint((one, MARKED.get(one)))}
    items = [(f'class="{key}"', meaning) for key, meaning in MEANINGS.items() if key in seen]
    shown = {bar.name for bar in chart.bars()}
    names = [(number, name) for number, name in enumerate(chart.names) if name in shown]
    items += [
        (f'fill="{dark(number)}"', cut(printable(name), LONGEST_LABEL))
        for number, name in names[:_MOST_NAMES]
    ]
    return items + [('fill="none"', f"and {len(names) - _MOST_NAMES} more messages")] * (
        len(names) > _MOST_NAMES
    )


def legend(items: list[tuple[str, str]], width: float, top: float) -> tuple[list[str], float]:
    """Return the shapes of a legend, in as many lines as needed, and the y below them."""
    lines: list[str] = []
    x, y = MARGIN, top
    for look, words in items:
        needed = svg.width_of(words) + 36
        if x + needed > width and x > MARGIN:
            x, y = MARGIN, y + _LINE
        lines.append(svg.rectangle(look, x, y, x + 14, 12))
        lines.append(svg.words("meaning", x + 20, y + 10, words))
        x += needed
    return lines, y + _LINE + 4


def patterns(chart: Chart) -> str:
    """Return the hatchings of messages: queued ones lean to one side, suspended to the other."""
    patterns = []
    numbers = {name: number for number, name in enumerate(chart.names)}
    for name, kind in sorted({(bar.name, bar.kind) for row in chart.rows for bar in row.queued}):
        angle, gap = (45, 5) if kind is BarKind.QUEUED else (-45, 9)
        patterns.append(
            f'<pattern id="{kind}{numbers[name]}" width="{gap}" height="5" '
            f'patternUnits="userSpaceOnUse" data-lean="rotate({angle})" '
            f'patternTransform="rotate({angle})"><rect width="{gap}" height="5" fill="#ffffff"/>'
            f'<rect width="2" height="5" fill="{dark(numbers[name])}"/></pattern>'
        )
    return f"<defs>{''.join(patterns)}</defs>"
