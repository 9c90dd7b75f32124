"""Schedules as text: a line for each agent, on one axis for all runs."""

from collections.abc import Iterator
from textwrap import wrap

from tca_tools.gantt.chart import Chart
from tca_tools.gantt.text import TextPage
from tca_tools.schedule.build import LEGEND, heading
from tca_tools.terminal import cut
from tca_wire.text.measures import duration
from tca_wire.text.printable import printable

_QUARTERS = (0.0, 0.25, 0.5, 0.75, 1.0)


def schedule_lines(some: list[Chart], width: int, blocks: dict[str, str]) -> Iterator[str]:
    """The schedules, line by line, in *width* columns."""
    page, longest = TextPage(some, width, blocks), max(one.end for one in some)
    for one in some:
        yield cut(printable(heading(one, longest)), width)
        yield from page.rows(one)
        for note in one.notes:
            yield from wrap(note, width, initial_indent="  ", subsequent_indent="    ")
    times = [(share, share * longest) for share in _QUARTERS]
    marks = [(time, f"{share:.0%} {duration(time)}") for share, time in times]
    yield from page.lines("", page.axis(marks, is_below=True))
    yield ""
    yield from page.legend(LEGEND)
