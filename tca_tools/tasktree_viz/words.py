"""The words for a task or a tree, in text and pictures: times, waits, failures, states."""

from collections import Counter
from collections.abc import Sequence
from textwrap import wrap
from typing import NamedTuple

from tca_tools.explain.wait_words import (
    Age,
    Last,
    age_of,
    in_the_end,
    named_waits_now,
    plans_in_words,
    shown_waits,
    unanswered_queries,
    verb_of,
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
from tca_wire.text.measures import counted, duration, ordinal
from tca_wire.text.printable import first_line, printable
from tca_wire.text.waits_in_words import several_in_words
from tca_wire.waits import WaitFor

_LONGEST_FAILURE = 200
_LONGEST_PROGRESS = 40
"""Columns of an intermediate result."""
_SHORTEST = 0.0005
"""Seconds: the time of a shorter wait is not shown."""
_LEAST = 20
"""Columns: in fewer, a wait is not shown beside its last cause."""


FOLDED_UP = (
    "that number of folded tasks; a part of the tree (--task, --module, --from, --to),"
    " or a .txt with --all, shows them"
)
"""The meaning of a row of folded tasks, in pictures."""


def lines_of(text: str, columns: int, most: int) -> list[str]:
    """Wrap a text in at most *most* lines."""
    return wrap(text, columns, max_lines=most, placeholder="…")


def _joined(between: str, *parts: str) -> str:
    """Join the parts that are not empty."""
    return between.join(filter(None, parts))


def span(task: TaskAt, interval: Interval) -> tuple[float, float | None] | None:
    """Return the start and end of an interval; the end is None while it lasts.

    Returns None before its start, and for the planning of a command.
    """
    start = task.reached.get(moment_of(interval, Edge.START))
    end = task.reached.get(moment_of(interval, Edge.END))
    is_leaf = interval is Interval.PLANNING and not task.message_class.is_goal
    if start is None or is_leaf or (start == end and task.why_killed is not None):
        return None  # a kill reaches all moments of a task, even if it never started
    return start, end


def times(task: TaskAt, interval: Interval) -> str:
    """Return an interval as ``1.30-4.25``, as ``1.30-`` while it lasts, and "" before it."""
    start, end = span(task, interval) or (None, None)
    if start is None:
        return ""
    return f"{start:.2f}-" if end is None else f"{start:.2f}-{end:.2f}"


def role(task: TaskAt) -> str:
    """Return the role of a task that central created or a coordinator sent early; else "".

    For example "listener", "exception handler", "monitor", or the fate of early work. A task that
    is handled again also has its attempt: "3rd try".
    """
    attempt = f"{ordinal(task.attempt)} try" if task.attempt > 1 else ""
    monitor = "monitor" * task.message_class.is_monitor
    return _joined(", ", monitor, task.role, task.preview, attempt)


def called(task: TaskAt) -> str:
    """Return a task's name with its role: ``stability check {7} (listener)``."""
    return printable(str(task)) + (f" ({its_role})" if (its_role := role(task)) else "")


def label(row: Row) -> str:
    """Return the name of a row's task, or the number of its folded tasks."""
    return called(row.task) if row.task else folded(row)


class TaskNote(NamedTuple):
    """The words beside a task's state: ``waits until move {4} is achieved, for 3 s; in the end
    ...``.
    """

    text: str = ""
    """The reason why it waits, or its outcome if that is not "done"."""
    age: Age | None = None
    """The start of the present wait, and the start of the uninterrupted waiting."""
    last: Last | None = None
    """The last cause of the wait, if it differs from the first."""
    waits: Sequence[WaitFor] = ()
    """The waits that the text names, as data."""

    @property
    def end(self) -> str:
        """``in the end for calibrate {3}, which no module handles``."""
        return printable(f"in the end {self.last}") if self.last else ""

    def within(self, room: int | None, time: float) -> str:
        """Return the note at a *time*, shortened to *room* columns.

        The duration is left out first. Then the text is cut. If too little of the text would
        remain, the last cause is left out.
        """
        lasted = lasting(self.age, time) if self.text else ""
        whole = _joined("; ", self.text + lasted, self.end)
        if room is None or columns_of(whole) <= room:
            return whole
        beside = room - columns_of(f"; {self.end}") if self.end else room
        if beside < _LEAST:
            return cut(self.text, room)
        return _joined("; ", cut(self.text, beside), self.end)


def note(at: RunAt, task: TaskAt, *, within: int | None = None) -> str:
    """Return why a task waits, for how long, and the last cause; or its outcome if not "done".

    The search for the last cause visits each wait of that instant at most once. If it needs more
    than *within* waits, the last cause is left out.
    """
    return note_of(at, task, within).within(None, at.time)


def note_of(at: RunAt, task: TaskAt, within: int | None = None, verb: str = "waits") -> TaskNote:
    """Return the parts of a task's note. *verb* stands before the causes of the wait."""
    if task.state in OVER:
        return TaskNote(failure_line(task.failure) or _why_killed(at, task))
    last = in_the_end(at, task, within)
    waits = shown_waits(at, task, with_children=False) or (shown_waits(at, task) if last else [])
    named = named_waits_now(at, task, waits)
    failed = failure_line(task.failure)
    if task.state is TaskState.ENDING and not failed:
        failed = _joined(": ", "killed", _why_killed(at, task))
    text, age = "; ".join(plans_in_words(at, task)), age_of(waits)
    state = _joined("; ", failed, _life(task))
    if waits:
        ahead = plans_in_words(at, task) if task.state is not TaskState.ENDING else []
        text = f"{verb_of(task, verb)} {several_in_words(named)}".lstrip() + (
            f" ({'; '.join(ahead)})" if ahead else ""
        )
    elif task.suspension and task.handling:
        since, by = task.suspension.start, by_whom(task.suspension.by)
        cause, age = at.describe(task.suspension.cause), Age(since, since)
        text = f"still runs, though {cause} is suspended{by}"
    elif queries := unanswered_queries(at, task):
        since = task.unanswered[0].received
        age = Age(since, since)
        text = f"continues while it waits {several_in_words(queries)}"
    text = _joined("; ", state, printable(text))
    return TaskNote(text, age, last, named)


def _life(task: TaskAt) -> str:
    """Return a client's open request and the progress: ``cancel requested, progress: 0.4``."""
    if not task.record.life:  # the common case
        return ""
    life = task.life
    parts = [life.state] * life.is_notable
    if state := task.machine_state:
        parts.append(f"in the state '{state}'")
    elif progress := _in_brief(life.progress):
        parts.append(f"progress: {cut(progress, _LONGEST_PROGRESS)}")
    return printable(", ".join(parts))


def _in_brief(progress: bytes) -> str:
    """Return an intermediate result; if it has a field *text*, only this field and its numbers."""
    data = plain_data(progress)
    text = data.get("text") if isinstance(data, dict) else None
    if not text or not isinstance(text, str):
        return data_text(progress)
    numbers = [one for one in data.items() if isinstance(one[1], int | float)]
    return ", ".join([text, *(f"{name} {value}" for name, value in numbers)])


def with_state(at: RunAt, task: TaskAt, note: TaskNote) -> str:
    """Return a task's state with its note: ``held, waits until ...``, ``failed: slip``."""
    text = note.within(None, at.time)
    if not text:
        return task.standing
    if task.state in (TaskState.RESOLVED, TaskState.FAILED, TaskState.KILLED, TaskState.ENDING):
        return f"{task.standing}: {text}"
    has_failed = task.failure and task.state is not TaskState.RECOVERING
    return f"{task.state}, failed: {text}" if has_failed else f"{task.state}, {text}"


def _why_killed(at: RunAt, task: TaskAt) -> str:
    """Return why a task was killed; "" if its parent was killed for the same reason."""
    above = at.tasks.get(task.parent)
    if above and above.why_killed == task.why_killed:
        return ""
    return printable(task.why_killed or "")


def lasting(age: Age | None, time: float) -> str:
    """Return ``, for 3.4 s``; with earlier waits, ``, for 3.4 s (8 s in all)``."""
    if age is None or time - age.begun < _SHORTEST:
        return ""
    since, begun = age
    in_all = f" ({duration(time - begun)} in all)" if since - begun >= _SHORTEST else ""
    return f", for {duration(time - since)}{in_all}"


def failure_line(text: str) -> str:
    """Return the first line of a failure's text, without a traceback."""
    return cut(printable(first_line(text)), _LONGEST_FAILURE)


def data(task: TaskAt) -> str:
    """Return a task's data with its result or its failure's data.

    For example ``{"leg": 2} -> {"z": 1.2}``, ``{"leg": 2} failed with 5``.
    """
    result, failed = data_text(task.result), data_text(task.failure_data)
    result, failed = result and f"-> {result}", failed and f"failed with {failed}"
    return _joined(" ", data_text(task.body), result, failed)


def tooltip(at: RunAt, task: TaskAt) -> str:
    """Return a task's name and state, its note and its data, in lines."""
    head = f"{called(task)}: {task.standing}"
    return _joined("\n", head, note(at, task), data(task))


def folded(row: Row) -> str:
    """Return the text of a row of folded tasks."""
    tasks = f"+ {counted(row.folded, 'task')}"
    if row.is_rest:
        return f"{tasks if row.folded else 'and more'} further down"
    if len(row.states) > 1:
        return f"{tasks}: {_counts(row.states)}"
    return f"{tasks} {row.state}".rstrip()


def _counts(states: Counter[str]) -> str:
    """Return ``2 held, 1 achieving``."""
    present = [standing for standing in STANDINGS if states[standing]]
    return ", ".join(f"{states[standing]:,} {standing}" for standing in present)


def summary(at: Forest, *, is_live: bool = False) -> str:
    """Return ``4.00 s, 8 tasks: 2 held, 1 achieving``, and whether the run continues."""
    counts = Counter(task.standing for task in at.tasks.values())
    states = _counts(counts)
    total = counted(len(at.tasks), "task")
    still = " (still running)" * is_live
    return f"{at.time:.2f} s{still}, {total}" + (f": {states}" if states else "")
