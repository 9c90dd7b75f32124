"""The task tree as a Graphviz picture, drawn as in figure 2 of Simmons 1994.

Narrow arrows lead down from a task to its subtasks, from left to right in the order of sending.
Heavy arrows are temporal constraints.
"""

from collections.abc import Iterator
from html import escape
from itertools import pairwise, starmap
from operator import itemgetter

from tca_tools.drawing.chart_dot import FAINT, graph, quoted, small, text
from tca_tools.journal.at_time import RunAt, TaskAt
from tca_tools.journal.coordinators import STANDINGS as PREVIEWED
from tca_tools.journal.fates import STANDINGS
from tca_tools.journal.records import TaskState
from tca_tools.tasktree_viz import words
from tca_tools.tasktree_viz.arrows import MEANINGS, Arrows, arrows, in_words
from tca_tools.tasktree_viz.looks import LOOKS
from tca_tools.tasktree_viz.outline import Row
from tca_tools.terminal import cut
from tca_wire.coordination import TaskRole
from tca_wire.points import Interval
from tca_wire.text.printable import printable
from tca_wire.vocabulary import Role

FILLS = {standing: fill for standing, (fill, _) in LOOKS.items()}
_HEAVY = "#0b4f8a"
_LONGEST_NAME, _LONGEST_DATA, _LONGEST_NOTE, _MOST_LINES = 36, 48, 160, 3
_LOOKS = f"""\
graph [nodesep=0.35, ranksep=0.45, forcelabels=true, newrank=true];
  edge [color="{FAINT}", penwidth=0.8, arrowsize=0.6];"""
ROLES = {
    Role.EXCEPTION: ("#b3261e", "exception handler"),
    Role.LISTENER: ("#7b3fa0", "sent by a wiretap"),
    Role.TERMINATION: ("#8a6d00", "to leave things safe"),
}
"""The border colours of tasks that central sent, with their meanings."""

_PREVIEWS = {
    TaskRole.AHEAD: "#2f7fd6",
    TaskRole.KEPT: "#2f7fd6",
    TaskRole.WASTED: "#a0522d",
    TaskRole.RESTORING: "#52606d",
}
_SENT_AHEAD = {
    PREVIEWED[role]: (colour, f"by a coordinator: {PREVIEWED[role]}")
    for role, colour in _PREVIEWS.items()
}
_LEGEND_LINE, _LEGEND_WIDTH = 18, 400
"""Generous: dot rejects a table that is too small for the fonts of the machine."""
_MONITOR = "#00796b", "monitor"
_CONSTRAINT = f'color="{_HEAVY}", fontcolor="{_HEAVY}", penwidth=2.6, arrowsize=0.8'


def dot_source(at: RunAt, rows: list[Row], title: str, *, with_data: bool = False) -> str:
    """Return the rows as a directed graph in the language of Graphviz."""
    found = arrows(at, {row.task.id for row in rows if row.task})
    label = f"label=<{_heading(rows, title, found)}>;"
    return graph([_LOOKS, label, *_statements(at, rows, found, with_data)], "tasks")


def _statements(at: RunAt, rows: list[Row], found: Arrows, with_data: bool) -> Iterator[str]:
    families: dict[int, list[str]] = {}
    for row in rows:
        families.setdefault(row.parent, []).append(_id(row))
    beside = {pair for siblings in families.values() for pair in pairwise(siblings)}
    # a label on an arrow between distant boxes would cover the boxes between them
    drawn = {
        (a, b): kinds for (a, b), kinds in found.between.items() if (f"t{a}", f"t{b}") in beside
    }
    constraints = in_words(at, found, drawn)
    for row in rows:
        yield _node(at, row, constraints, with_data)
    for row in rows:
        if row.parent >= 0:
            yield f"{_id(rows[row.parent])} -> {_id(row)} [weight=2];"
    for (before, after), kinds in found.between.items():
        kind = " · ".join(kinds)
        tooltip = printable(f"{at.describe(before)} to {at.describe(after)}: {kind}")
        label = kind if (before, after) in drawn else ""
        looks = f"label={_quoted(label)}, tooltip={_quoted(tooltip)}, {_CONSTRAINT}"
        if at.tasks[before].parent != at.tasks[after].parent:
            looks += ", constraint=false"
        yield f"t{before} -> t{after} [{looks}];"
    connected = {(f"t{before}", f"t{after}") for before, after in found.between}
    for siblings in families.values():
        unconnected = [pair for pair in pairwise(siblings) if pair not in connected]
        order = " ".join(f"{a} -> {b} [style=invis];" for a, b in unconnected)
        if len(siblings) > 1:
            yield f"{{ rank=same; {'; '.join(siblings)}; {order} }}"


def _id(row: Row) -> str:
    return f"t{row.task.id}" if row.task else f"f{row.number}"


def _node(at: RunAt, row: Row, constraints: dict[int, list[str]], with_data: bool) -> str:
    if row.task is None:
        fill = FILLS.get(row.state, "#ffffff")
        style = f'fontsize=10, style="filled,dashed", fillcolor="{fill}"'
        return f'{_id(row)} [label="{words.folded(row)}", {style}];'
    task, state = row.task, row.task.standing
    style = "filled,rounded" if task.message_class.is_goal else "filled"
    style += ",dashed" if task.state is TaskState.HELD else ""
    lines = _label_lines(at, task, constraints.get(task.id, []), with_data)
    special = border_of(task)
    border = f', color="{special[0]}", penwidth=2.2' if special else ""
    tooltip = _quoted(words.tooltip(at, task))
    rest = f'style="{style}", fillcolor="{FILLS[state]}", tooltip={tooltip}{border}'
    return f"{_id(row)} [label=<{'<br/>'.join(lines)}>, {rest}];"


def border_of(task: TaskAt) -> tuple[str, str] | None:
    """Return the border colour of a special task and its meaning; None for other tasks.

    Special are tasks that central sent, monitors, and early work of a coordinator.
    """
    if task.message_class.is_monitor:
        return _MONITOR
    return ROLES.get(task.role) or _SENT_AHEAD.get(task.preview)


def _label_lines(at: RunAt, task: TaskAt, constraints: list[str], with_data: bool) -> Iterator[str]:
    yield f'{text(task.name)} <font color="{FAINT}">{{{task.id}}}</font>'
    times = ""  # those of achieving; before it starts, those of planning
    if span := words.span(task, Interval.ACHIEVING) or words.span(task, Interval.PLANNING):
        start, end = span
        times = f" since {start:.2f}" if end is None else f" {start:.2f}\N{EN DASH}{end:.2f}"
    yield small(f"{task.standing}{times}")
    for one in constraints:
        lines = words.lines_of(printable(one), _LONGEST_NAME, _MOST_LINES)
        yield from (small(line, _HEAVY) for line in lines)
    if task.failure or task.why_killed is not None:
        yield from map(small, words.lines_of(words.note(at, task), _LONGEST_NAME, _MOST_LINES))
    if with_data and (data := words.data(task)):
        yield small(cut(data, _LONGEST_DATA))


def borders(rows: list[Row]) -> list[tuple[str, str]]:
    """Return the border colours that occur in the rows, with their meanings."""
    found = {border_of(row.task) for row in rows if row.task}
    return sorted(filter(None, found), key=itemgetter(1))


def _heading(rows: list[Row], title: str, found: Arrows) -> str:
    """Return the title, and below it the meanings of colours, shapes and arrows."""
    present = {row.task.standing for row in rows if row.task}
    states = [state for state in STANDINGS if state in present]
    lines = [f'<font point-size="14"><b>{escape(title)}</b></font>']
    swatches = "".join(
        f'<td bgcolor="{FILLS[state]}" border="1" color="{FAINT}">'
        f'<font point-size="10">{state}</font></td>'
        for state in states
    )
    kinds = found.kinds
    meanings = [(_HEAVY, kind, MEANINGS[kind]) for kind in MEANINGS if kind in kinds]
    meanings += [(colour, "border", meaning) for colour, meaning in borders(rows)]
    if states:
        width = sum(len(state) * 7 + 18 for state in states)  # generous, as _LEGEND_WIDTH
        looks = (
            f'border="0" cellspacing="4" align="left" fixedsize="true" width="{width}" height="28"'
        )
        lines.append(f"<table {looks}><tr>{swatches}</tr></table>")
    if meanings:
        size = f'fixedsize="true" width="{_LEGEND_WIDTH}" height="{_LEGEND_LINE * len(meanings)}"'
        looks = f'border="0" cellborder="0" cellspacing="0" align="left" {size}'
        lines.append(f"<table {looks}>{''.join(starmap(_meaning, meanings))}</table>")
    if any(row.folded for row in rows):
        folded = escape(words.FOLDED_UP)
        lines.append(f'<font point-size="10">dashed, with +: {folded}</font>')
    rows_of_table = "".join(f'<tr><td align="left">{line}</td></tr>' for line in lines)
    return (
        f'<table border="0" cellborder="0" cellspacing="2" cellpadding="1">{rows_of_table}</table>'
    )


def _meaning(colour: str, what: str, meaning: str) -> str:
    """Return a line of the legend."""
    font = f'<font point-size="10" color="{colour}">'
    first = f'<td align="left">{font}<b>{what}</b></font></td>'
    return f'<tr>{first}<td align="left" width="280">{font}{meaning}</font></td></tr>'


def _quoted(text: str) -> str:
    return quoted(*cut(text, _LONGEST_NOTE * 2).split("\n"))
