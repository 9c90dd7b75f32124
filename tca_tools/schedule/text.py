"""Schedules as text: a line for each agent, with one time axis for all runs."""

from collections.abc import Iterator
from textwrap import wrap

from tca_tools.gantt.chart import Chart
from tca_tools.gantt.text import TextPage
from tca_tools.schedule.build import LEGEND, heading
from tca_tools.terminal import cut
from tca_wire.text.measures import duration
from tca_wire.text.printable import printable

_QUARTERS = (0.0, 0.25, 0.5, 0.75, 1.0)


def schedule_lines(charts: list[Chart], width: int, blocks: dict[str, str]) -> Iterator[str]:
    """Yield the lines of schedules, in *width* columns."""
    page, longest = TextPage(charts, width, blocks), max(chart.end for chart in charts)
    for chart in charts:
        yield cut(printable(heading(chart, longest)), width)
        yield from page.rows(chart)
        for note in chart.notes:
            yield from wrap(note, width, initial_indent="  ", subsequent_indent="    ")
    times = [(share, share * longest) for share in _QUARTERS]
    marks = [(time, f"{share:.0%} {duration(time)}") for share, time in times]
    yield from page.lines("", page.axis(marks, is_below=True))
    yield ""
    yield from page.legend(LEGEND)
