"""The task tree as a picture, in the language of Graphviz: as figure 2 of Simmons 1994 draws it.

Narrow arrows down lead from a task to its subtasks, which stand from left to right as they were sent; heavy arrows are
temporal constraints.
"""

from collections.abc import Iterable, Iterator, Sequence
from html import escape
from itertools import pairwise, starmap
from operator import itemgetter

from tca_tools.run.at_time import RunAt, TaskAt
from tca_tools.run.fates import HANDLED, STANDINGS, WATCHING
from tca_tools.run.records import State
from tca_tools.tasktree_viz import words
from tca_tools.tasktree_viz.arrows import MEANINGS, Arrows, arrows
from tca_tools.tasktree_viz.outline import Row
from tca_tools.terminal import cut
from tca_wire.points import Interval
from tca_wire.text.measures import listed
from tca_wire.text.printable import printable
from tca_wire.vocabulary import Role

FILLS: dict[str, str] = {
    State.HELD: "#ffffff",
    State.QUEUED: "#fff3c4",
    State.PLANNING: "#e9d8fd",
    State.PLANNED: "#d6e4ff",
    State.HANDLING: "#ffcf70",
    State.ACHIEVING: "#ffe4b0",
    WATCHING: "#cdeef2",
    State.ACHIEVED: "#cfeccb",
    State.RECOVERING: "#ffc9a3",
    State.SUSPENDED: "#e6e6c8",
    State.ENDING: "#e8c4c0",
    State.FAILED: "#f28b82",
    HANDLED: "#dfae3f",
    State.KILLED: "#d5d5d5",
}
_INK, _FAINT, _HEAVY = "#1f2933", "#52606d", "#0b4f8a"
_LONGEST_NAME, _LONGEST_DATA, _LONGEST_NOTE, _MOST_LINES = 36, 48, 160, 3
_LOOKS = f"""\
  graph [fontname="Helvetica,Arial,sans-serif", fontsize=12, fontcolor="{_INK}", labelloc=t, labeljust=l,
    bgcolor=white, pad=0.3, nodesep=0.35, ranksep=0.45, forcelabels=true, newrank=true];
  node [shape=box, fontname="Helvetica,Arial,sans-serif", fontsize=12, fontcolor="{_INK}", color="{_INK}",
    penwidth=1, margin="0.12,0.06", height=0.3];
  edge [fontname="Helvetica,Arial,sans-serif", fontsize=10, color="{_FAINT}", penwidth=0.8, arrowsize=0.6];
"""
ROLES = {
    Role.EXCEPTION: ("#b3261e", "exception handler"),
    Role.LISTENER: ("#7b3fa0", "sent by a wiretap"),
    Role.TERMINATION: ("#8a6d00", "to leave things safe"),
}
"""The colour of the border of what central itself sent, and what that is."""

_LEGEND_LINE, _LEGEND_WIDTH = 18, 400
"""Generous, as dot complains of tables too small where a machine has only fonts with large letters."""
_MONITOR = "#00796b", "monitor"
_CONSTRAINT = f'color="{_HEAVY}", fontcolor="{_HEAVY}", penwidth=2.6, arrowsize=0.8'


def dot_source(at: RunAt, rows: list[Row], title: str, *, with_data: bool = False) -> str:
    """A directed graph of the rows."""
    found = arrows(at, {row.task.id for row in rows if row.task})
    body = "\n".join(f"  {line}" for line in _statements(at, rows, found, with_data))
    return f"digraph tasks {{\n{_LOOKS}  label=<{_heading(rows, title, found)}>;\n{body}\n}}\n"


def _statements(at: RunAt, rows: list[Row], found: Arrows, with_data: bool) -> Iterator[str]:
    families = list(_brothers(rows))
    beside = {pair for brothers in families for pair in pairwise(map(_id, brothers))}
    far: dict[int, list[str]] = {}
    for (before, after), kinds in found.between.items():
        if (f"t{before}", f"t{after}") not in beside:  # words on an arrow over others would lie on those
            far.setdefault(after, []).append(f"{' · '.join(kinds)}: after {at.describe(before)}")
    for after, words_of in _unseen(at, found):
        far.setdefault(after, []).append(words_of)
    for row in rows:
        said = [*_own(row, found), *far.get(row.task.id, ())] if row.task else []
        yield _node(at, row, said, with_data)
    for row in rows:
        if row.parent >= 0:
            yield f"{_id(rows[row.parent])} -> {_id(row)} [weight=2];"
    joined = set()
    for (before, after), kinds in found.between.items():
        pair = f"t{before}", f"t{after}"
        joined.add(pair)
        yield _constraint_arrow(at, before, after, kinds, is_named=pair in beside)
    for brothers in families:
        names = list(map(_id, brothers))
        order = " ".join(f"{a} -> {b} [style=invis];" for a, b in pairwise(names) if (a, b) not in joined)
        yield f"{{ rank=same; {'; '.join(names)}; {order} }}"


def _unseen(at: RunAt, found: Arrows) -> Iterator[tuple[int, str]]:
    """For tasks shown, after which ones they come that are not."""
    names: dict[tuple[int, str], list[str]] = {}
    for (before, after), kinds in found.unseen.items():
        names.setdefault((after, " · ".join(kinds)), []).append(at.describe(before))
    return ((after, f"{what}: after {listed(some)}") for (after, what), some in names.items())


def _own(row: Row, found: Arrows) -> list[str]:
    """The constraints of a task on itself and its parent, in a line."""
    own = found.own.get(row.task.id, []) if row.task else []
    return [", ".join(own)] if own else []


def _id(row: Row) -> str:
    return f"t{row.task.id}" if row.task else f"f{row.number}"


def _brothers(rows: list[Row]) -> Iterable[list[Row]]:
    """The rows under each row (and under the root), left to right, where there are several."""
    below: dict[int, list[Row]] = {}
    for row in rows:
        below.setdefault(row.parent, []).append(row)
    return (brothers for brothers in below.values() if len(brothers) > 1)


def _constraint_arrow(at: RunAt, before: int, after: int, kinds: Sequence[str], *, is_named: bool) -> str:
    what = " · ".join(kinds)
    tooltip = printable(f"{at.describe(before)} to {at.describe(after)}: {what}")
    label = what if is_named else ""
    siblings = at.tasks[before].parent == at.tasks[after].parent
    rank = "" if siblings else ", constraint=false"
    return f"t{before} -> t{after} [label={_quoted(label)}, tooltip={_quoted(tooltip)}, {_CONSTRAINT}{rank}];"


def _node(at: RunAt, row: Row, said: list[str], with_data: bool) -> str:
    if row.task is None:
        fill = FILLS.get(row.state, "#ffffff")
        label = words.folded(row)
        return f'{_id(row)} [label="{label}", fontsize=10, style="filled,dashed", fillcolor="{fill}"];'
    task, state = row.task, row.task.standing
    style = "filled,rounded" if task.message_class.is_goal else "filled"
    style += ",dashed" if task.state is State.HELD else ""
    tooltip = "\n".join(filter(None, [f"{words.called(task)}: {state}", words.note(at, task), words.data(task)]))
    label = "<br/>".join(_label_lines(at, task, said, with_data))
    border = f', color="{looks[0]}", penwidth=2.2' if (looks := looks_of(task)) else ""
    rest = f'style="{style}", fillcolor="{FILLS[state]}", tooltip={_quoted(tooltip)}{border}'
    return f"{_id(row)} [label=<{label}>, {rest}];"


def looks_of(task: TaskAt) -> tuple[str, str] | None:
    """The border of a task that no module sent, or that no module handles; and what it is."""
    return _MONITOR if task.message_class.is_monitor else ROLES.get(task.role)


def _label_lines(at: RunAt, task: TaskAt, said: list[str], with_data: bool) -> Iterator[str]:
    name = escape(cut(printable(task.name), _LONGEST_NAME))
    yield f'{name} <font color="{_FAINT}">{{{task.id}}}</font>'
    yield _small(" ".join(filter(None, [task.standing, _times(task)])))
    for line in (line for one in said for line in _wrapped(printable(one))):
        yield f'<font point-size="9" color="{_HEAVY}">{escape(line)}</font>'
    if task.failure or task.why_killed is not None:
        yield from map(_small, _wrapped(words.note(at, task)))
    if with_data and (data := words.data(task)):
        yield _small(cut(data, _LONGEST_DATA))


def _wrapped(text: str) -> list[str]:
    """A few lines as long as names may be."""
    return words.lines_of(text, _LONGEST_NAME, _MOST_LINES)


def _times(task: TaskAt) -> str:
    """When it was achieved or, before that is so, planned."""
    span = words.span(task, Interval.ACHIEVING) or words.span(task, Interval.PLANNING)
    if not span:
        return ""
    start, end = span
    return f"since {start:.2f}" if end is None else f"{start:.2f}–{end:.2f}"  # noqa: RUF001 - an en dash is right here


def _small(text: str) -> str:
    return f'<font point-size="9" color="{_FAINT}">{escape(text)}</font>'


def _heading(rows: list[Row], title: str, found: Arrows) -> str:
    """The title, and below it what colours, shapes and arrows mean."""
    found_there = {row.task.standing for row in rows if row.task}
    states = [state for state in STANDINGS if state in found_there]
    swatches = "".join(
        f'<td bgcolor="{FILLS[state]}" border="1" color="{_FAINT}"><font point-size="10">{state}</font></td>'
        for state in states
    )
    lines = [f'<font point-size="14"><b>{escape(title)}</b></font>']
    if states:
        width = sum(len(state) * 7 + 18 for state in states)  # generous, too
        looks = f'border="0" cellspacing="4" align="left" fixedsize="true" width="{width}" height="28"'
        lines.append(f"<table {looks}><tr>{swatches}</tr></table>")
    meanings = [(_HEAVY, kind, meaning) for kind, meaning in MEANINGS.items() if kind in found.kinds]
    borders = {border for row in rows if row.task and (border := looks_of(row.task))}
    meanings += [(colour, "border", meaning) for colour, meaning in sorted(borders, key=itemgetter(1))]
    if meanings:
        size = f'fixedsize="true" width="{_LEGEND_WIDTH}" height="{_LEGEND_LINE * len(meanings)}"'
        looks_of_table = f'border="0" cellborder="0" cellspacing="0" align="left" {size}'
        lines.append(f"<table {looks_of_table}>{''.join(starmap(_meaning, meanings))}</table>")
    rows_of_table = "".join(f'<tr><td align="left">{line}</td></tr>' for line in lines)
    return f'<table border="0" cellborder="0" cellspacing="2" cellpadding="1">{rows_of_table}</table>'


def _meaning(colour: str, what: str, meaning: str) -> str:
    """A line of the legend."""
    font = f'<font point-size="10" color="{colour}">'
    first = f'<td align="left">{font}<b>{what}</b></font></td>'
    return f'<tr>{first}<td align="left" width="280">{font}{meaning}</font></td></tr>'


def _quoted(text: str) -> str:
    text = cut(text, _LONGEST_NOTE * 2).replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    return f'"{text}"'
