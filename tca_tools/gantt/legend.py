"""The legend of a chart: its colours and hatchings."""

from collections.abc import Iterator

from tca_tools.drawing import svg
from tca_tools.gantt.axis import Scale
from tca_tools.gantt.chart import MARKED, MEANINGS, BarKind, Chart, Ending
from tca_tools.gantt.looks import AHEAD, COLOURS, LONGEST_LABEL, MARGIN, dark
from tca_tools.gantt.queues import CURVE, is_curve
from tca_tools.terminal import cut
from tca_wire.coordination import TaskRole
from tca_wire.text.printable import printable
from tca_wire.vocabulary import Outcome

_LINE = 24.0
_MOST_NAMES = 40
"""A robot has so many messages at most whose colours can be told apart."""
_GREY = "#52606d"
HATCHING = (
    '<pattern id="wasted" width="6" height="6" patternUnits="userSpaceOnUse" patternTransform="rotate(45)">'
    f'<rect width="6" height="6" fill="#ffffff"/><rect width="3" height="6" fill="{AHEAD}"/></pattern>'
)
"""What was wasted."""
_WHOLE = 'width="1" height="1" patternContentUnits="objectBoundingBox"'
_LOOKS: dict[str, str] = {
    BarKind.HANDLED: 'fill="#3e4c59"',
    BarKind.WAITING: 'fill="#c5cbd3"',
    BarKind.QUEUED: 'fill="url(#queued)"',
    BarKind.SUSPENDED: 'fill="url(#suspended)"',
    BarKind.HELD: f'fill="#ffffff" stroke="{_GREY}" stroke-dasharray="4 3"',
    BarKind.LOCKED: 'class="locked"',
    BarKind.RESERVED: 'class="reserved"',
    TaskRole.AHEAD: 'class="ahead"',
    TaskRole.WASTED: 'class="wasted"',
    Ending.FAILED: 'class="failed"',
    Ending.COPED: 'class="coped"',
    Ending.RESOLVED: 'class="resolved"',
    Ending.KILLED: 'fill="url(#killed)"',
    **{words: f'fill="{COLOURS[ending]}"' for ending, words in MARKED.items()},
}
"""The square of each meaning, as attributes of a ``<rect>``."""
_FLAGS = (
    (Ending.FAILED, "flag", "here something failed"),
    (Ending.COPED, "amber-flag", "here something failed, and was handled"),
    (Ending.RESOLVED, "olive-flag", f"here something failed, and is {Outcome.RESOLVED}"),
)


def meanings(chart: Chart, scale: Scale) -> list[tuple[str, str]]:
    """The squares of the legend (attributes of a ``<rect>``), and what each means."""
    seen, curves = chart.seen(), {id(row) for row in chart.rows if is_curve(row, scale)}
    hatched = {bar.kind for row in chart.rows for bar in row.queued if id(row) not in curves}
    seen -= {BarKind.QUEUED, BarKind.SUSPENDED} - hatched
    items = [(_LOOKS[key], MEANINGS[key]) for key in MEANINGS if key in seen & _LOOKS.keys()]
    items += [(f'fill="{CURVE}"', "how many are queued or suspended")] * bool(curves)
    for ending, flag, words in _FLAGS:
        if not seen.isdisjoint((ending, MARKED.get(ending))):
            items.append((f'fill="url(#{flag})"', words))
    shown = {bar.name for bar in chart.bars()}
    names = [(number, name) for number, name in enumerate(chart.names) if name in shown]
    items += [(f'fill="{dark(number)}"', cut(printable(name), LONGEST_LABEL)) for number, name in names[:_MOST_NAMES]]
    return items + [('fill="none"', f"and {len(names) - _MOST_NAMES} more messages")] * (len(names) > _MOST_NAMES)


def legend(items: list[tuple[str, str]], width: float, top: float) -> tuple[list[str], float]:
    """Squares with their meanings, in as many lines as they need; and where what follows may begin."""
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


def patterns(chart: Chart, *, of_names: bool = True) -> str:
    """The hatchings: of what queues, leaning to one side, and of what is suspended, to the other."""
    return f"<defs>{''.join(_of_names(chart) if of_names else _of_legend())}</defs>"


def _of_legend() -> Iterator[str]:
    yield from (_pattern(kind, "", _GREY) for kind in (BarKind.QUEUED, BarKind.SUSPENDED))
    yield HATCHING
    yield f'<pattern id="killed" {_WHOLE}><rect width="1" height="1" fill="#8a97a5"/>'
    yield f'<rect x="0.75" width="0.25" height="1" fill="{COLOURS[Ending.KILLED]}"/></pattern>'
    for ending, flag, _ in _FLAGS:
        yield f'<pattern id="{flag}" {_WHOLE}><path d="M0.2 0.2 h0.6 l-0.3 0.6 z" fill="{COLOURS[ending]}"/></pattern>'


def _of_names(chart: Chart) -> Iterator[str]:
    numbers = {name: number for number, name in enumerate(chart.names)}
    for name, kind in sorted({(bar.name, bar.kind) for row in chart.rows for bar in row.queued}):
        yield _pattern(kind, str(numbers[name]), dark(numbers[name]))


def _pattern(kind: BarKind, number: str, colour: str) -> str:
    angle, gap = (45, 5) if kind is BarKind.QUEUED else (-45, 9)
    return (
        f'<pattern id="{kind}{number}" width="{gap}" height="5" patternUnits="userSpaceOnUse" '
        f'data-lean="rotate({angle})" patternTransform="rotate({angle})"><rect width="{gap}" height="5" '
        f'fill="#ffffff"/><rect width="2" height="5" fill="{colour}"/></pattern>'
    )
