"""What the text and the picture say about a task: its times, why it waits, how it failed; and about a whole tree."""

from collections import Counter
from typing import NamedTuple

from tca_tools.analysis.words import seconds
from tca_tools.coping import STANDINGS
from tca_tools.data import data_text
from tca_tools.ends import in_the_end
from tca_tools.records import OVER, State
from tca_tools.selection import Forest
from tca_tools.tasktree_viz.outline import Row
from tca_tools.terminal import cut, printable
from tca_tools.then import TaskThen, Then
from tca_tools.waiting import coming, dealing, waits_how, waits_since, why_waiting
from tca_wire.points import Edge, Interval, TaskId, moment_of
from tca_wire.wording import by_whom

_LONGEST_FAILURE = 200
_SHORTEST_TEXT = 30
"""Columns that a reason keeps beside what comes of it in the end."""
_THEN = "; "
_SHORTEST = 0.0005
"""Seconds: of a wait that has just begun nothing is said."""


def span(task: TaskThen, interval: Interval) -> tuple[float, float | None] | None:
    """From when until when (None: it goes on); None before. A command is a leaf: of its planning nothing is told."""
    start = task.reached.get(moment_of(interval, Edge.START))
    end = task.reached.get(moment_of(interval, Edge.END))
    is_leaf = interval is Interval.PLANNING and not task.message_class.is_goal
    if start is None or is_leaf or (start == end and task.why_killed is not None):
        return None  # the moments of what was killed count as reached, though it was never begun
    return start, end


def role(task: TaskThen) -> str:
    """Why there is such a task, if not because a module wanted it done: "listener", "exception handler", "monitor"."""
    kind = "monitor" if task.message_class.is_monitor else ""
    return ", ".join(filter(None, (kind, task.role)))


def called(task: TaskThen) -> str:
    """Its name, with its role: ``stability check {7} (listener)``."""
    return printable(str(task)) + (f" ({said})" if (said := role(task)) else "")


class Note(NamedTuple):
    """What is said beside a task's state."""

    text: str
    """What keeps it waiting, or how it ended if not well."""
    since: float | None = None
    """Since when it waits."""
    end: str = ""
    """What it waits for in the end, if that says more: ``in the end for calibrate {3}, which no module handles``."""

    def within(self, room: int | None) -> str:
        """As much of both as there is room for: of the text its beginning, before the end is cut."""
        if not self.end or not self.text:
            return cut(self.text or self.end, room)
        if room is not None:
            least = max(room - len(self.end) - len(_THEN), _SHORTEST_TEXT)
            return cut(f"{cut(self.text, least)}{_THEN}{self.end}", room)
        return f"{self.text}{_THEN}{self.end}"


def note(then: Then, task: TaskThen, *, with_end: bool = True) -> str:
    """What keeps it waiting and for how long it has, and what it waits for in the end; or how it ended if not well.

    Looking for the end may lead through all that waits at that moment, though through each only once.
    """
    found = note_of(then, task) if with_end else Note(*_text_since(then, task))
    return found.within(None) + (lasting(then.time - found.since) if found.since is not None else "")


def note_of(then: Then, task: TaskThen) -> Note:
    """The same in its parts."""
    text, since = _text_since(then, task)
    end = in_the_end(then, task)
    if not end:
        return Note(text, since)
    return Note(text, waits_since(task) if since is None else since, printable(f"in the end {end}"))


def _text_since(then: Then, task: TaskThen) -> tuple[str, float | None]:
    """What keeps it waiting, and since when it does; or how it ended if not well (None)."""
    if task.state is State.ENDING:
        return _ending(then, task), waits_since(task)
    if task.state is State.RECOVERING:
        return _recovering(then, task), waits_since(task)
    if task.failure and task.state in OVER:
        return failure_line(task.failure), None
    if task.why_killed is not None:
        return _why_killed(then, task), None
    text, since = _going_on(then, task)
    return "; ".join(filter(None, (failure_line(task.failure), text))), since


def _recovering(then: Then, task: TaskThen) -> str:
    """Who takes care of its failure, what that is, and what else keeps it."""
    _, *more = why_waiting(then, TaskId(task.id))
    failure = failure_line(task.failure) or "its failure"
    return printable(f"{waits_how(task)} {', and '.join([dealing(then, task, failure), *more])}")


def _going_on(then: Then, task: TaskThen) -> tuple[str, float | None]:
    """What keeps it from going on, or else what is to come."""
    reasons = why_waiting(then, TaskId(task.id), with_children=False)  # they are shown
    ahead = coming(then, task)
    if reasons:
        more = f" ({'; '.join(ahead)})" if ahead else ""
        return printable(f"{waits_how(task)} {', and '.join(reasons)}{more}"), waits_since(task)
    if task.suspension and task.handling:
        return printable(
            f"still runs, though {then.describe(task.suspension.cause)} is suspended{by_whom(task.suspension.by)}"
        ), task.suspension.start
    return printable("; ".join(ahead)), None


def _why_killed(then: Then, task: TaskThen) -> str:
    """Why, if that is not said of what it is under."""
    above = then.tasks.get(task.parent)
    return "" if above and above.why_killed == task.why_killed else printable(task.why_killed or "")


def _ending(then: Then, task: TaskThen) -> str:
    """What keeps a killed task from its end, and why it was killed."""
    if not (why := failure_line(task.failure)):
        why = f"killed: {why}" if (why := _why_killed(then, task)) else "killed"
    keeps = printable(", and ".join(why_waiting(then, TaskId(task.id))))
    return f"{why}; {keeps}" if keeps else why


def lasting(length: float) -> str:
    """``, for 3.40 s``."""
    return f", for {seconds(length)}" if length >= _SHORTEST else ""


def failure_line(text: str) -> str:
    """A failure in one line: of a traceback, what comes before it."""
    first, *rest = text.strip().splitlines() or [""]
    return cut(printable(first), _LONGEST_FAILURE) + (" ..." if any(map(str.strip, rest)) else "")


def data(task: TaskThen) -> str:
    """Its data and result, or the data of its failure: ``{"leg": 2} -> {"z": 1.2}``, ``{"leg": 2} failed with 5``."""
    given, result, failure_data = map(data_text, (task.body, task.result, task.failure_data))
    return " ".join(filter(None, (given, result and f"-> {result}", failure_data and f"failed with {failure_data}")))


def folded(row: Row) -> str:
    """What a row says that stands for several tasks."""
    return f"+ {row.folded} task{'s' * (row.folded != 1)} {row.state}"


def summary(then: Forest, *, is_live: bool = False) -> str:
    """``4.00 s, 8 tasks: 2 held, 1 achieving``; of a run that goes on, as of when."""
    counts = Counter(task.standing for task in then.tasks.values())
    states = ", ".join(f"{counts[standing]} {standing}" for standing in STANDINGS if counts[standing])
    total = f"{len(then.tasks)} task{'s' * (len(then.tasks) != 1)}"
    still = " (still running)" * is_live
    return f"{then.time:.2f} s{still}, {total}" + (f": {states}" if states else "")
