"""The pictures of a report, as SVG: a Gantt chart of the run or of a telling part, and how busy
resources were.
"""

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
"""A chart of more is of a part of the run."""
_WIDEST = 1300.0
"""Pixels of a plot, which is seen on most screens without scrolling."""
_STRIPS, _CELLS = 24, 240


class Gantt(NamedTuple):
    """A Gantt chart."""

    chart: Chart
    pieces: Pieces
    why: str
    """Why this part is shown, if it is one."""


class Strip(NamedTuple):
    """How busy a resource was, in equal parts of the run."""

    name: str
    cells: list[tuple[int, float]]
    """Those that are not empty: the number of the part, and the busy share (0 to 1)."""


def gantt(history: History, found: Contents) -> Gantt | None:
    """The work of every module over the whole run, or in its most telling part; None if nothing was
    handled.
    """
    if not history.handlings and not history.queueings:
        return None
    drawing, why = chart(history), ""
    if len(history.handlings) + len(history.queueings) > _BARS_AT_MOST:
        middle, why = _telling(found)
        drawing = chart(history, *_window(history, middle))
    return Gantt(drawing, pieces_of(drawing, widest=_WIDEST), why)


def _telling(found: Contents) -> tuple[float, str]:
    """The time to look at, and why."""
    cases = [case for kind in found.kinds for case in kind.cases]
    bad = [case for case in cases if case.fate not in GOOD_FATES]
    if bad:
        first = min(bad, key=lambda case: case.time)
        why = f"around the first failure that was not overcome, of {first.of}"
        return first.time, why
    if found.advice and (window := found.advice[0].window):
        return window[0], "around the example of the first advice below"
    return found.summary.start, "where the run begins"


def _window(history: History, middle: float) -> tuple[float, float]:
    """Times around *middle* between which about so many bars begin as a chart may have."""
    starts = [handling.start for handling in history.handlings if handling.delivery]
    place = bisect_left(starts, middle)
    first = max(place - _BARS_AT_MOST // 8, 0)
    last = min(first + _BARS_AT_MOST // 4, len(starts) - 1)
    start, end = (starts[first], starts[last]) if starts else (middle, history.time)
    return start, max(end, start)


def strips(history: History, found: Contents) -> list[Strip]:
    """The busiest resources, each with its busy share along the run."""
    start, length = found.summary.start, found.summary.seconds / _CELLS
    made: list[Strip] = []
    for use in found.uses[:_STRIPS]:
        runs = history.runs.get(use.key, [])
        if not runs or length <= 0:
            continue
        now = history.time
        cover = Cover((run.start, now if run.end is None else run.end) for run in runs)
        cells = []
        for n in range(_CELLS):
            since = start + n * length
            share = cover.within(since, since + length) / length
            if share > 0.004:
                cells.append((n, round(min(share, 1.0), 2)))
        made.append(Strip(use.name, cells))
    return made
