"""The words for a task in text and picture: its times, why it waits, how it failed; and for a whole
tree.
"""

from collections import Counter
from collections.abc import Sequence
from textwrap import wrap
from typing import NamedTuple

from tca_tools.explain.wait_words import (
    Age,
    Last,
    age_of,
    asked,
    coming,
    how,
    in_the_end,
    named_waits_now,
    shown,
)
from tca_tools.journal.at_time import RunAt, TaskAt
from tca_tools.journal.fates import STANDINGS
from tca_tools.journal.records import OVER, TaskState
from tca_tools.journal.selection import Forest
from tca_tools.tasktree_viz.outline import Row
from tca_tools.terminal import columns_of, cut
from tca_wire.points import Edge, Interval, moment_of
from tca_wire.text.bodies import data_text, plain_data
from tca_wire.text.facts_in_words import by_whom
from tca_wire.text.measures import counted, duration
from tca_wire.text.printable import first_line, printable
from tca_wire.text.waits_in_words import several_in_words
from tca_wire.waits import WaitFor

_LONGEST_FAILURE = 200
_LONGEST_PROGRESS = 40
"""Columns of an intermediate result."""
_SHORTEST = 0.0005
"""Seconds: of a wait that has just begun nothing is said."""
_LEAST = 20
"""Columns of a wait that say something beside its last cause."""


FOLDED_UP = "so many tasks folded up; a part of the tree (--task, --module, --from, --to), or a .txt with --all, shows them"
"""What a row means that stands for several tasks, in pictures."""


def lines_of(text: str, columns: int, most: int) -> list[str]:
    """A text of a picture in a few lines."""
    return wrap(text, columns, max_lines=most, placeholder="…")


def _joined(between: str, *parts: str) -> str:
    """The parts that say anything."""
    return between.join(filter(None, parts))


def span(task: TaskAt, interval: Interval) -> tuple[float, float | None] | None:
    """The start and end of an interval (end None: it goes on); None before it, and for a command's
    planning.
    """
    start = task.reached.get(moment_of(interval, Edge.START))
    end = task.reached.get(moment_of(interval, Edge.END))
    is_leaf = interval is Interval.PLANNING and not task.message_class.is_goal
    if start is None or is_leaf or (start == end and task.why_killed is not None):
        return None  # the moments of what was killed count as reached, though it was never begun
    return start, end


def times(task: TaskAt, interval: Interval) -> str:
    """``1.30-4.25``, ``1.30-`` while it goes on; "" before it."""
    start, end = span(task, interval) or (None, None)
    if start is None:
        return ""
    return f"{start:.2f}-" if end is None else f"{start:.2f}-{end:.2f}"


def role(task: TaskAt) -> str:
    """Why there is such a task, if not because a module wanted it done: "listener", "exception
    handler", "monitor"; of one that a coordinator sent ahead of its state what became of that.
    """
    return _joined(", ", "monitor" * task.message_class.is_monitor, task.role, task.preview)


def called(task: TaskAt) -> str:
    """Its name, with its role: ``stability check {7} (listener)``."""
    return printable(str(task)) + (f" ({said})" if (said := role(task)) else "")


def label(row: Row) -> str:
    """The name of a row's task, or how many tasks it stands for."""
    return called(row.task) if row.task else folded(row)


class TaskNote(NamedTuple):
    """The words beside a task's state: ``waits until move {4} is achieved, for 3 s; in the end
    ...``.
    """

    text: str = ""
    """The reason why it waits, or how it ended if not well."""
    age: Age | None = None
    """Since when that keeps it waiting, and since when it waits in all."""
    last: Last | None = None
    """The last thing it waits for, if that says more."""
    waits: Sequence[WaitFor] = ()
    """The waits that the text names, as data."""

    @property
    def end(self) -> str:
        """``in the end for calibrate {3}, which no module handles``."""
        return printable(f"in the end {self.last}") if self.last else ""

    def within(self, room: int | None, time: float) -> str:
        """As much of it at a *time* as there is room for: first goes for how long it waits, and
        last its last cause.
        """
        lasted = lasting(self.age, time) if self.text else ""
        whole = _joined("; ", self.text + lasted, self.end)
        if room is None or columns_of(whole) <= room:
            return whole
        beside = room - columns_of(f"; {self.end}") if self.end else room
        return (
            _joined("; ", cut(self.text, beside), self.end)
            if beside >= _LEAST
            else cut(self.text, room)
        )


def note(at: RunAt, task: TaskAt, *, within: int | None = None) -> str:
    """The reason why a task waits, for how long, and its last cause; or how it ended if not well.

    Looking for the end may lead through all that waits at that moment, though through each only
    once: *within* at most so many waits, else nothing is said of it.
    """
    return note_of(at, task, within).within(None, at.time)


def note_of(at: RunAt, task: TaskAt, within: int | None = None, verb: str = "waits") -> TaskNote:
    """The parts of a task's note. The *verb* goes before the things that it waits for."""
    if task.state in OVER:
        return TaskNote(failure_line(task.failure) or _why_killed(at, task))
    last = in_the_end(at, task, within)
    waits = shown(at, task, with_children=False) or (shown(at, task) if last else [])
    told = named_waits_now(at, task, waits)
    failed = failure_line(task.failure)
    if task.state is TaskState.ENDING and not failed:
        failed = _joined(": ", "killed", _why_killed(at, task))
    text, age = "; ".join(coming(at, task)), age_of(waits)
    said = _joined("; ", failed, _life(task))
    if waits:
        ahead = coming(at, task) if task.state is not TaskState.ENDING else []
        text = f"{how(task, verb)} {several_in_words(told)}".lstrip() + (
            f" ({'; '.join(ahead)})" if ahead else ""
        )
    elif task.suspension and task.handling:
        since, by = task.suspension.start, by_whom(task.suspension.by)
        cause, age = at.describe(task.suspension.cause), Age(since, since)
        text = f"still runs, though {cause} is suspended{by}"
    elif queries := asked(at, task):
        since = task.asking[0].received
        age = Age(since, since)
        text = f"goes on while it waits {several_in_words(queries)}"
    text = _joined("; ", said, printable(text))
    return TaskNote(text, age, last, told)


def _life(task: TaskAt) -> str:
    """What a client has asked for, while that is open, and the newest progress: ``cancel requested,
    progress: 0.4``.
    """
    if not task.record.life:  # as most
        return ""
    life = task.life
    told = [life.state] * life.is_telling
    if state := task.machine_state:
        told.append(f"in the state '{state}'")
    elif progress := _in_brief(life.progress):
        told.append(f"progress: {cut(progress, _LONGEST_PROGRESS)}")
    return printable(", ".join(told))


def _in_brief(progress: bytes) -> str:
    """An intermediate result; of one with a field *text* that, and its numbers."""
    data = plain_data(progress)
    text = data.get("text") if isinstance(data, dict) else None
    if not text or not isinstance(text, str):
        return data_text(progress)
    numbers = [one for one in data.items() if isinstance(one[1], int | float)]
    return ", ".join([text, *(f"{name} {value}" for name, value in numbers)])


def with_state(at: RunAt, task: TaskAt, note: TaskNote) -> str:
    """A note behind the task's state: ``held, waits until ...``, ``failed: slip``."""
    told = note.within(None, at.time)
    if not told:
        return task.standing
    if task.state in (TaskState.RESOLVED, TaskState.FAILED, TaskState.KILLED, TaskState.ENDING):
        return f"{task.standing}: {told}"
    says_how = task.failure and task.state is not TaskState.RECOVERING
    return f"{task.state}, failed: {told}" if says_how else f"{task.state}, {told}"


def _why_killed(at: RunAt, task: TaskAt) -> str:
    """Why, if that is not said of what it is under."""
    above = at.tasks.get(task.parent)
    if above and above.why_killed == task.why_killed:
        return ""
    return printable(task.why_killed or "")


def lasting(its_age: Age | None, time: float) -> str:
    """``, for 3.4 s`` and, if it waited for something else before, `` (8 s in all)``."""
    if its_age is None or time - its_age.begun < _SHORTEST:
        return ""
    since, begun = its_age
    in_all = f" ({duration(time - begun)} in all)" if since - begun >= _SHORTEST else ""
    return f", for {duration(time - since)}{in_all}"


def failure_line(text: str) -> str:
    """A failure in one line: of a traceback, what comes before it."""
    return cut(printable(first_line(text)), _LONGEST_FAILURE)


def data(task: TaskAt) -> str:
    """Its data and result, or the data of its failure: ``{"leg": 2} -> {"z": 1.2}``, ``{"leg": 2}
    failed with 5``.
    """
    result, failed = data_text(task.result), data_text(task.failure_data)
    result, failed = result and f"-> {result}", failed and f"failed with {failed}"
    return _joined(" ", data_text(task.body), result, failed)


def tooltip(at: RunAt, task: TaskAt) -> str:
    """All there is to say about a task, in lines."""
    head = f"{called(task)}: {task.standing}"
    return _joined("\n", head, note(at, task), data(task))


def folded(row: Row) -> str:
    """The text of a row that stands for several tasks."""
    tasks = f"+ {counted(row.folded, 'task')}"
    if row.is_rest:
        return f"{tasks if row.folded else 'and more'} further down"
    if len(row.states) > 1:
        return f"{tasks}: {_counts(row.states)}"
    return f"{tasks} {row.state}".rstrip()


def _counts(states: Counter[str]) -> str:
    """``2 held, 1 achieving``."""
    there = [standing for standing in STANDINGS if states[standing]]
    return ", ".join(f"{states[standing]:,} {standing}" for standing in there)


def summary(at: Forest, *, is_live: bool = False) -> str:
    """``4.00 s, 8 tasks: 2 held, 1 achieving``; of a run that goes on, as of when."""
    counts = Counter(task.standing for task in at.tasks.values())
    states = _counts(counts)
    total = counted(len(at.tasks), "task")
    still = " (still running)" * is_live
    return f"{at.time:.2f} s{still}, {total}" + (f": {states}" if states else "")
