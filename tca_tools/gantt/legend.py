"""The legend of a chart: its colours and hatchings."""

from collections.abc import Iterator
from html import escape

from tca_tools.drawing.svg import width_of
from tca_tools.gantt.axis import Scale
from tca_tools.gantt.chart import Chart, Ending, Kind
from tca_tools.gantt.looks import COLOURS, LONGEST_LABEL, MARGIN, dark
from tca_tools.gantt.queues import CURVE, is_curve
from tca_tools.terminal import cut
from tca_wire.text.printable import printable

_LINE = 24.0
_MOST_NAMES = 40
"""A robot has so many messages at most whose colours can be told apart."""
_GREY = "#52606d"
_WHOLE = 'width="1" height="1" patternContentUnits="objectBoundingBox"'
_RAISED = "failure raised beside the handler"
_ENDINGS = {
    Ending.FAILED: ('class="failed"', "failed"),
    Ending.COPED: ('class="coped"', "failed, and handled"),
    Ending.KILLED: ('fill="url(#killed)"', "killed"),
}


def meanings(chart: Chart, scale: Scale) -> list[tuple[str, str]]:
    """The squares of the legend (attributes of a ``<rect>``), and what each means."""
    curves = [is_curve(row, scale) for row in chart.rows]
    hatched = {bar.kind for row, is_long in zip(chart.rows, curves, strict=True) if not is_long for bar in row.queued}
    claims, marked = chart.claims(), {mark.ending for mark in chart.marks()}
    ended = {bar.ending for bar in chart.bars()}
    items = [
        ('fill="#3e4c59"', "handling", True),
        ('fill="#c5cbd3"', "waiting for a reply, task or lock", True),
        ('fill="url(#queued)"', "queued", Kind.QUEUED in hatched or not any(curves)),
        ('fill="url(#suspended)"', "suspended", Kind.SUSPENDED in hatched),
        (f'fill="{CURVE}"', "how many are queued or suspended", any(curves)),
        (f'fill="#ffffff" stroke="{_GREY}" stroke-dasharray="4 3"', "held", any(row.held for row in chart.rows)),
        *((f'class="{kind}"', kind, kind in claims) for kind in (Kind.LOCKED, Kind.RESERVED)),
        *((*look, ending in ended) for ending, look in _ENDINGS.items()),
        (f'fill="{COLOURS[Ending.FAILED]}"', _RAISED, Ending.FAILED in marked),
        (f'fill="{COLOURS[Ending.COPED]}"', f"{_RAISED}, and handled", Ending.COPED in marked),
        ('fill="url(#flag)"', "here something failed", Ending.FAILED in ended | marked),
        ('fill="url(#amber-flag)"', "here something failed, and was handled", Ending.COPED in ended | marked),
    ]
    return [(look, words) for look, words, is_seen in items if is_seen] + list(_names(chart))


def _names(chart: Chart) -> Iterator[tuple[str, str]]:
    shown = {bar.name for bar in chart.bars()}
    names = [(number, name) for number, name in enumerate(chart.names) if name in shown]
    for number, name in names[:_MOST_NAMES]:
        yield f'fill="{dark(number)}"', cut(printable(name), LONGEST_LABEL)
    if len(names) > _MOST_NAMES:
        yield 'fill="none"', f"and {len(names) - _MOST_NAMES} more messages"


def legend(items: list[tuple[str, str]], width: float, top: float) -> tuple[list[str], float]:
    """Squares with their meanings, in as many lines as they need; and where what follows may begin."""
    lines: list[str] = []
    x, y = MARGIN, top
    for look, words in items:
        needed = width_of(words) + 36
        if x + needed > width and x > MARGIN:
            x, y = MARGIN, y + _LINE
        lines.append(f'<rect {look} x="{x:.1f}" y="{y:.1f}" width="14" height="12"/>')
        lines.append(f'<text x="{x + 20:.1f}" y="{y + 10:.1f}">{escape(words)}</text>')
        x += needed
    return lines, y + _LINE + 4


def patterns(chart: Chart, *, of_names: bool = True) -> str:
    """The hatchings: of what queues, leaning to one side, and of what is suspended, to the other."""
    return f"<defs>{''.join(_of_names(chart) if of_names else _of_legend())}</defs>"


def _of_legend() -> Iterator[str]:
    yield _pattern(Kind.QUEUED, "", _GREY)
    yield _pattern(Kind.SUSPENDED, "", _GREY)
    yield f'<pattern id="killed" {_WHOLE}><rect width="1" height="1" fill="#8a97a5"/>'
    yield f'<rect x="0.75" width="0.25" height="1" fill="{COLOURS[Ending.KILLED]}"/></pattern>'
    for flag, ending in (("flag", Ending.FAILED), ("amber-flag", Ending.COPED)):
        yield f'<pattern id="{flag}" {_WHOLE}><path d="M0.2 0.2 h0.6 l-0.3 0.6 z" fill="{COLOURS[ending]}"/></pattern>'


def _of_names(chart: Chart) -> Iterator[str]:
    queued = {(bar.name, bar.kind) for row in chart.rows for bar in row.queued}
    for number, name in enumerate(chart.names):
        for kind in (Kind.QUEUED, Kind.SUSPENDED):
            if (name, kind) in queued:
                yield _pattern(kind, str(number), dark(number))


def _pattern(kind: Kind, number: str, colour: str) -> str:
    angle, gap = (45, 5) if kind is Kind.QUEUED else (-45, 9)
    return (
        f'<pattern id="{kind}{number}" width="{gap}" height="5" patternUnits="userSpaceOnUse" '
        f'data-lean="rotate({angle})" patternTransform="rotate({angle})"><rect width="{gap}" height="5" '
        f'fill="#ffffff"/><rect width="2" height="5" fill="{colour}"/></pattern>'
    )
