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
"""The hatchings of squares of the legend, and of what was wasted."""
_LINE = 24.0
_MOST_NAMES = 40
"""A robot has so many messages at most whose colours can be told apart."""


def meanings(chart: Chart, scale: Scale) -> list[tuple[str, str]]:
    """The squares of the legend (attributes of a ``<rect>``), and what each means."""
    seen, curves = chart.seen(), {id(row) for row in chart.rows if is_curve(row, scale)}
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
    """Squares with their meanings, in as many lines as they need; and where what follows may
    begin.
    """
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
    """The hatchings of messages: of what queues, leaning to one side, and of what is suspended, to
    the other.
    """
    made = []
    numbers = {name: number for number, name in enumerate(chart.names)}
    for name, kind in sorted({(bar.name, bar.kind) for row in chart.rows for bar in row.queued}):
        angle, gap = (45, 5) if kind is BarKind.QUEUED else (-45, 9)
        made.append(
            f'<pattern id="{kind}{numbers[name]}" width="{gap}" height="5" patternUnits="userSpaceOnUse" '
            f'data-lean="rotate({angle})" patternTransform="rotate({angle})"><rect width="{gap}" height="5" '
            f'fill="#ffffff"/><rect width="2" height="5" fill="{dark(numbers[name])}"/></pattern>'
        )
    return f"<defs>{''.join(made)}</defs>"
