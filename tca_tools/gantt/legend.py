"""What the colours and hatchings of a chart mean."""

from collections.abc import Iterator
from html import escape

from tca_tools.drawing.svg import width_of
from tca_tools.gantt.colours import dark
from tca_tools.gantt.parts import Chart
from tca_tools.gantt.queues import CURVE, is_curve
from tca_tools.gantt.scale import Scale
from tca_tools.gantt.shapes import COPED, FAILED, KILLED, LONGEST_LABEL, MARGIN
from tca_tools.terminal import cut
from tca_wire.text.printable import printable

_LINE = 24.0
_MOST_NAMES = 40
"""A robot has so many messages at most whose colours can be told apart."""
_RAISED = "failure raised beside the handler"
_GREY = "#52606d"
_WHOLE = 'width="1" height="1" patternContentUnits="objectBoundingBox"'


def meanings(chart: Chart, scale: Scale) -> list[tuple[str, str]]:
    """What a square may look like (attributes of a ``<rect>``), and what that means."""
    bars = [bar for row in chart.rows for bar in row.bars]
    held = [one for row in chart.rows for one in row.held if one.end >= chart.start and one.start <= chart.end]
    shown = {bar.name for bar in bars}
    items = [('fill="#3e4c59"', "handling"), ('fill="#c5cbd3"', "waiting for a reply, task or lock")]
    curves = [is_curve(row, scale) for row in chart.rows]
    hatched = {
        bar.is_suspended for row, curve in zip(chart.rows, curves, strict=True) if not curve for bar in row.queued
    }
    items += [('fill="url(#queued)"', "queued")] * (False in hatched or not any(curves))
    items += [('fill="url(#suspended)"', "suspended")] * (True in hatched)
    items += [(f'fill="{CURVE}"', "how many are queued or suspended")] * any(curves)
    items += [(f'fill="#ffffff" stroke="{_GREY}" stroke-dasharray="4 3"', "held")] * any(
        row.held_back for row in chart.rows
    )
    items += [('class="locked"', "locked")] * any(not one.is_reserved for one in held)
    items += [('class="reserved"', "reserved")] * any(one.is_reserved for one in held)
    items += [('class="failed"', "failed")] * any(bar.has_failed and not bar.has_coped for bar in bars)
    items += [('class="coped"', "failed, and handled")] * any(bar.has_coped for bar in bars)
    items += [('fill="url(#killed)"', "killed")] * any(bar.was_killed for bar in bars)
    marks = [mark for bar in bars for mark in bar.raised if chart.start <= mark.time <= chart.end]
    items += [(f'fill="{FAILED}"', _RAISED)] * any(not mark.has_coped for mark in marks)
    items += [(f'fill="{COPED}"', f"{_RAISED}, and handled")] * any(mark.has_coped for mark in marks)
    flags = {bar.has_coped for bar in bars if bar.has_failed} | {mark.has_coped for mark in marks}
    items += [('fill="url(#flag)"', "here something failed")] * (False in flags)
    items += [('fill="url(#amber-flag)"', "here something failed, and was handled")] * (True in flags)
    names = [(number, name) for number, name in enumerate(chart.names) if name in shown]
    items += [(f'fill="{dark(number)}"', cut(printable(name), LONGEST_LABEL)) for number, name in names[:_MOST_NAMES]]
    items += [('fill="none"', f"and {len(names) - _MOST_NAMES} more messages")] * (len(names) > _MOST_NAMES)
    return items


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
    yield _pattern("queued", _GREY, 45)
    yield _pattern("suspended", _GREY, -45, gap=9)
    yield f'<pattern id="killed" {_WHOLE}><rect width="1" height="1" fill="#8a97a5"/>'
    yield f'<rect x="0.75" width="0.25" height="1" fill="{KILLED}"/></pattern>'
    for flag, colour in (("flag", FAILED), ("amber-flag", COPED)):
        yield f'<pattern id="{flag}" {_WHOLE}><path d="M0.2 0.2 h0.6 l-0.3 0.6 z" fill="{colour}"/></pattern>'


def _of_names(chart: Chart) -> Iterator[str]:
    bars = [bar for row in chart.rows for bar in row.queued]
    queued = {bar.name for bar in bars if not bar.is_suspended}
    suspended = {bar.name for bar in bars if bar.is_suspended}
    for number, name in enumerate(chart.names):
        if name in queued:
            yield _pattern(f"queued{number}", dark(number), 45)
        if name in suspended:
            yield _pattern(f"suspended{number}", dark(number), -45, gap=9)


def _pattern(name: str, colour: str, angle: int, gap: int = 5) -> str:
    return (
        f'<pattern id="{name}" width="{gap}" height="5" patternUnits="userSpaceOnUse" data-lean="rotate({angle})" '
        f'patternTransform="rotate({angle})"><rect width="{gap}" height="5" fill="#ffffff"/>'
        f'<rect width="2" height="5" fill="{colour}"/></pattern>'
    )
