"""The pictures of a report, as SVG: a Gantt chart of the run or of a telling part, and how busy resources were."""

import re
from bisect import bisect_left
from dataclasses import dataclass

from tca_tools.analysis.failures import GOOD_FATES
from tca_tools.analysis.spans import Cover
from tca_tools.gantt.bars import Chart, chart
from tca_tools.gantt.svg import svg_text
from tca_tools.history import History
from tca_tools.report.contents import Contents

_BARS_AT_MOST = 2500
"""A chart of more is of a part of the run."""
_STRIPS, _CELLS = 24, 240


@dataclass(frozen=True)
class Gantt:
    """A Gantt chart."""

    svg: str
    start: float
    end: float
    is_whole: bool
    why: str
    """Why this part is shown, if it is one."""

    @property
    def width(self) -> int:
        """How many pixels wide it is when its letters have their size."""
        found = re.search(r'<svg [^>]*width="(\d+)', self.svg)
        return int(found[1]) if found else 0


@dataclass(frozen=True)
class Strip:
    """How busy a resource was, in equal parts of the run."""

    name: str
    cells: list[tuple[int, float]]
    """Those that are not empty: the number of the part, and the busy share (0 to 1)."""


def gantt(history: History, found: Contents) -> Gantt:
    """What every module did when: in the whole run, or in a part that tells most."""
    if not history.handlings and not history.queueings:
        return Gantt("", 0.0, 0.0, True, "")
    bars = len(history.handlings) + len(history.queueings)
    if bars <= _BARS_AT_MOST:
        drawing = chart(history)
        return Gantt(svg_text(drawing, _title(drawing)), drawing.start, drawing.end, True, "")
    middle, why = _telling(found)
    start, end = _window(history, middle)
    drawing = chart(history, start, end)
    return Gantt(svg_text(drawing, _title(drawing)), start, end, False, why)


def _title(drawing: Chart) -> str:
    return f"{drawing.start:.2f} to {drawing.end:.2f} s"


def _telling(found: Contents) -> tuple[float, str]:
    """The time to look at, and why."""
    bad = [case for kind in found.kinds for case in kind.cases if case.fate not in GOOD_FATES]
    if bad:
        first = min(bad, key=lambda case: case.time)
        return first.time, f"around the first failure that was not overcome, of {first.of}"
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
        cover = Cover((run.start, history.time if run.end is None else run.end) for run in runs)
        shares = (cover.within(start + n * length, start + (n + 1) * length) / length for n in range(_CELLS))
        cells = [(n, round(min(share, 1.0), 2)) for n, share in enumerate(shares) if share > 0.004]
        made.append(Strip(use.name, cells))
    return made
