"""The pictures of a report, as SVG: the Gantt chart, and the use of resources."""

from bisect import bisect_left
from typing import NamedTuple

from tca_tools.gantt.build import chart
from tca_tools.gantt.chart import Chart
from tca_tools.gantt.svg import Pieces, pieces_of
from tca_tools.journal.fates import GOOD_FATES
from tca_tools.journal.fold import History
from tca_tools.report.contents import Contents
from tca_tools.spans import Cover

_BARS_AT_MOST = 2500
"""The most bars of a chart; a run with more is shown in part."""
_WIDEST = 1300.0
"""Pixels: the width of a plot that fits most screens without scrolling."""
_STRIPS, _CELLS = 24, 240
"""The most resources whose use is shown, and the parts of the run."""
_LEAST_SHARE = 0.004
"""A smaller busy share would be invisible."""


class Gantt(NamedTuple):
    """A Gantt chart."""

    chart: Chart
    pieces: Pieces
    why: str
    """Why this part of the run is shown; "" for the whole run."""


class Strip(NamedTuple):
    """The use of a resource in equal parts of the run."""

    name: str
    cells: list[tuple[int, float]]
    """The number and the busy share (0 to 1) of each part that is not idle."""


def gantt(history: History, found: Contents) -> Gantt | None:
    """Return the chart of the run, or of its most important part if it is long.

    Return None if no handler ran.
    """
    if not history.handlings and not history.queueings:
        return None
    drawing, why = chart(history), ""
    if len(history.handlings) + len(history.queueings) > _BARS_AT_MOST:
        middle, why = _focus(found)
        drawing = chart(history, *_window(history, middle))
    return Gantt(drawing, pieces_of(drawing, widest=_WIDEST), why)


def _focus(found: Contents) -> tuple[float, str]:
    """Return the time around which a long run is shown, and why."""
    cases = [case for kind in found.kinds for case in kind.cases]
    bad = [case for case in cases if case.fate not in GOOD_FATES]
    if bad:
        first = min(bad, key=lambda case: case.time)
        why = f"around the first failure that was not dealt with, of {first.of}"
        return first.time, why
    if found.advice and (window := found.advice[0].window):
        return window[0], "around the example of the first advice below"
    return found.summary.start, "at the start of the run"


def _window(history: History, middle: float) -> tuple[float, float]:
    """Return a span around *middle* with about as many bars as a chart may have."""
    starts = [handling.start for handling in history.handlings if handling.delivery]
    place = bisect_left(starts, middle)
    first = max(place - _BARS_AT_MOST // 8, 0)
    last = min(first + _BARS_AT_MOST // 4, len(starts) - 1)
    start, end = (starts[first], starts[last]) if starts else (middle, history.time)
    return start, max(end, start)


def strips(history: History, found: Contents) -> list[Strip]:
    """Return the busiest resources, each with its busy share in each part of the run."""
    start, length = found.summary.start, found.summary.seconds / _CELLS
    built: list[Strip] = []
    for use in found.uses[:_STRIPS]:
        handlings, now = history.by_resource.get(use.key, []), history.time
        if not handlings or length <= 0:
            continue
        spans = ((one.start, now if one.end is None else one.end) for one in handlings)
        cover, cells = Cover(spans), []
        for number in range(_CELLS):
            since = start + number * length
            if (share := cover.within(since, since + length) / length) > _LEAST_SHARE:
                cells.append((number, round(min(share, 1.0), 2)))
        built.append(Strip(use.name, cells))
    return built
