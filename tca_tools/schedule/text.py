"""Schedules as text: a line for each agent, on one axis for all runs."""

import textwrap
from collections.abc import Iterator, Sequence

from tca_tools.gantt.cells import TICK, Cells
from tca_tools.gantt.chart import MEANINGS, BarKind
from tca_tools.gantt.text import paint_handled
from tca_tools.schedule.build import CURRENT, AgentRow, AgentSchedule
from tca_tools.terminal import columns_of, cut, padded
from tca_wire.coordination import TaskRole
from tca_wire.text.measures import duration, percent
from tca_wire.text.printable import printable

_WIDEST_LABEL = 24
_QUARTERS = (0.0, 0.25, 0.5, 0.75, 1.0)


def schedule_lines(some: Sequence[AgentSchedule], width: int, blocks: dict[str, str]) -> Iterator[str]:
    """The schedules, line by line, in *width* columns."""
    longest = max(one.seconds for one in some)
    labels = max(columns_of(printable(row.agent)) for one in some for row in one.rows)
    labels = min(labels, _WIDEST_LABEL, width // 2)
    columns = max(width - labels - 2, 1)
    for one in some:
        yield cut(f"{printable(one.title)}: {duration(one.seconds)}, {percent(one.seconds / longest)}", width)
        for row in one.rows:
            for number, cells in enumerate(_lanes(row, longest, columns, blocks)):
                yield f"{padded('' if number else printable(row.agent), labels)}  {cells.line()}".rstrip()
        for note in one.notes:
            yield from textwrap.wrap(note, width, initial_indent="  ", subsequent_indent="    ")
    for cells in _axis(longest, columns, blocks):
        yield f"{' ' * labels}  {cells.line()}".rstrip()
    yield ""
    meant: dict[str, str] = {BarKind.HANDLED: CURRENT}
    meant |= {role: MEANINGS[role] for role in (TaskRole.AHEAD, TaskRole.WASTED)}
    yield cut("  ".join([*(f"{blocks[kind] * 2} {meaning}" for kind, meaning in meant.items()), "w waiting"]), width)


def _lanes(row: AgentRow, longest: float, columns: int, blocks: dict[str, str]) -> Iterator[Cells]:
    lanes = [Cells(0.0, longest, columns) for _ in range(max([1, *(box.lane + 1 for box in row.boxes)]))]
    for start, end in row.gaps:
        lanes[0].paint(start, end, blocks[BarKind.SUSPENDED], "w", "bright_black")
    for box in row.boxes:
        paint_handled(lanes[box.lane], box, blocks, "blue" if box.ahead else None)
    yield from lanes


def _axis(longest: float, columns: int, blocks: dict[str, str]) -> Iterator[Cells]:
    marks, words = Cells(0.0, longest, columns), Cells(0.0, longest, columns)
    taken = -1
    for share in _QUARTERS:
        label = f"{share:.0%} {duration(share * longest)}"
        at = min(marks.column(share * longest), columns - 1)
        marks.put(at, [blocks[TICK]], None)
        first = min(at, columns - len(label))
        if first > taken:
            words.put(first, list(label), None)
            taken = first + len(label)
    yield from (marks, words)
