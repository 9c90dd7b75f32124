"""What the text and the picture say about a task: its times, why it waits, how it failed; and about a whole tree."""

import re
from collections import Counter
from collections.abc import Iterator
from textwrap import wrap
from typing import NamedTuple

from tca_tools.analysis.words import seconds
from tca_tools.run.at_time import RunAt, TaskAt
from tca_tools.run.records import OVER, State
from tca_tools.run.selection import Forest
from tca_tools.tasktree_viz.outline import Row
from tca_tools.terminal import columns_of, cut
from tca_tools.why.ages import Age, age
from tca_tools.why.coping import STANDINGS
from tca_tools.why.last import last_of
from tca_tools.why.waiting import coming, dealing, waits_how, why_waiting
from tca_wire.points import Edge, Interval, TaskId, moment_of
from tca_wire.text.bodies import data_text
from tca_wire.text.facts_in_words import by_whom
from tca_wire.text.printable import printable

_LONGEST_FAILURE = 200
_WAITS, _THEN, _IN_THE_END = "waits ", "; ", "in the end "
_CLAUSE = re.compile(r"( (is|has been) [a-z ]+)?")
"""What may stand behind the name of what is waited for."""
_END = re.compile(r"^(.*?)(, which .*?)?(, and for \d+ (?:or more )?others?)?$")
"""What it is in the end, why that stands, and how many more there are."""
_SHORTEST_NAME = 5
"""Columns that are left of the name of an end."""
_CAUSE = re.compile(r"^(?:(?:suspended by [^,]*|killed|asked),? )?[^,{]*(?:\{\d+\})?")
"""What of a reason names the cause."""
_SHORTEST = 0.0005
"""Seconds: of a wait that has just begun nothing is said."""
_BEFORE_UNIT = re.compile(r"(?<=\d) (?=(?:s|ms|µs|min|h)\b)")
_STUCK = "\N{NO-BREAK SPACE}"


def lines_of(text: str, columns: int, most: int) -> list[str]:
    """A text of a picture in a few lines; a number stays with its unit."""
    lines = wrap(_BEFORE_UNIT.sub(_STUCK, text), columns, max_lines=most, placeholder="…")
    return [line.replace(_STUCK, " ") for line in lines]


def span(task: TaskAt, interval: Interval) -> tuple[float, float | None] | None:
    """From when until when (None: it goes on); None before. A command is a leaf: of its planning nothing is told."""
    start = task.reached.get(moment_of(interval, Edge.START))
    end = task.reached.get(moment_of(interval, Edge.END))
    is_leaf = interval is Interval.PLANNING and not task.message_class.is_goal
    if start is None or is_leaf or (start == end and task.why_killed is not None):
        return None  # the moments of what was killed count as reached, though it was never begun
    return start, end


def role(task: TaskAt) -> str:
    """Why there is such a task, if not because a module wanted it done: "listener", "exception handler", "monitor"."""
    kind = "monitor" if task.message_class.is_monitor else ""
    return ", ".join(filter(None, (kind, task.role)))


def called(task: TaskAt) -> str:
    """Its name, with its role: ``stability check {7} (listener)``."""
    return printable(str(task)) + (f" ({said})" if (said := role(task)) else "")


class Note(NamedTuple):
    """What is said beside a task's state: ``waits until move {4} is achieved, for 3.00 s (8.00 s in all); in the end
    for ...``.
    """

    text: str
    """What keeps it waiting, or how it ended if not well."""
    age: Age | None = None
    """Since when that keeps it waiting, and since when it waits in all."""
    end: str = ""
    """What it waits for in the end, if that says more: ``in the end for calibrate {3}, which no module handles``; where
    the text names that already, why it waits for nothing else: ``no module handles that``."""
    alone: str = ""
    """The end with its name."""

    def within(self, room: int | None, time: float) -> str:
        """As much of it at a *time* as there is room for. For how long it waits for this gives way first, then for how
        long in all; then why the end stands, what follows the cause in the text, and the end. The cause stays.
        """
        told = lasting(self.age, time) if self.text else ""
        whole = self._with_end(f"{self.text}{told}", self.end)
        if room is None or columns_of(whole) <= room:
            return whole
        if not self.text:
            ends = [end for one in (self.end, _briefly(self.end)) for end in (one, one.removeprefix(_IN_THE_END))]
            return next((one for one in ends if columns_of(one) <= room), _shortened(ends[-1], room))
        return next(self._fitting(_in_all(told), room), cut(self.text, room))

    def _with_end(self, told: str, end: str) -> str:
        return _THEN.join(filter(None, (told, end)))

    def _fitting(self, lasted: str, room: int) -> Iterator[str]:
        """What has room and names the cause, the best first."""
        brief = _briefly(self.end)
        for end in dict.fromkeys((self.end, brief, "")):
            made = (self._with_end(f"{self.text}{one}", end) for one in (lasted, ""))
            yield from (one for one in made if columns_of(one) <= room)
            if end == brief or not end:
                yield from self._cut(end, lasted, room)

    def _cut(self, end: str, lasted: str, room: int) -> Iterator[str]:
        """The same with a part of the text."""
        for text in (self.text, self.text.removeprefix(_WAITS)):
            cause = _CAUSE.match(text)
            least = columns_of(cause[0].rstrip()) if cause else 0
            for one in (lasted, ""):
                behind = f"{one}{_THEN * bool(end)}{end}"
                if (left := room - columns_of(behind)) > least:
                    yield f"{cut(text, left)}{behind}"


def _briefly(end: str) -> str:
    """An end without why it stands."""
    return _END.sub(r"\1\3", end)


def _shortened(end: str, room: int) -> str:
    """An end in little room: with its number, by which it is found."""
    named, space, number = end.partition(" {")
    number = f"{space}{number.partition('}')[0]}}}"
    left = room - columns_of(number)
    return cut(named, left) + number if space and left >= _SHORTEST_NAME else cut(end, room)


def note(at: RunAt, task: TaskAt, *, within: int | None = None) -> str:
    """What keeps it waiting and for how long it has, and what it waits for in the end; or how it ended if not well.

    Looking for the end may lead through all that waits at that moment, though through each only once: *within* at most
    so many waits, else nothing is said of it.
    """
    return note_of(at, task, within).within(None, at.time)


def note_of(at: RunAt, task: TaskAt, within: int | None = None) -> Note:
    """The same in its parts."""
    last = last_of(at, task, within)
    text, its_age = _text_and_age(at, task, has_end=bool(last))
    if not last:
        return Note(text, its_age)
    alone = printable(f"{_IN_THE_END}{last}")
    end = printable(last.behind) if _names_only(text, printable(last.thing)) else alone
    return Note(text, its_age, end, alone)


def _names_only(text: str, thing: str) -> bool:
    """Whether a wait is for that alone, and no more is said of it."""
    before, found, after = text.partition(thing)
    return bool(found) and "{" not in before and bool(_CLAUSE.fullmatch(after))


def _text_and_age(at: RunAt, task: TaskAt, *, has_end: bool) -> tuple[str, Age | None]:
    """What keeps it waiting, and since when it does; or how it ended if not well (None)."""
    if task.state is State.ENDING:
        return _ending(at, task), age(at, task)
    if task.state is State.RECOVERING:
        return _recovering(at, task), age(at, task)
    if task.failure and task.state in OVER:
        return failure_line(task.failure), None
    if task.why_killed is not None:
        return _why_killed(at, task), None
    text, its_age = _going_on(at, task, has_end=has_end)
    return "; ".join(filter(None, (failure_line(task.failure), text))), its_age


def _recovering(at: RunAt, task: TaskAt) -> str:
    """Who takes care of its failure, what that is, and what else keeps it."""
    _, *more = why_waiting(at, TaskId(task.id))
    failure = failure_line(task.failure) or "its failure"
    return printable(f"{waits_how(task)} {', and '.join([dealing(at, task, failure), *more])}")


def _going_on(at: RunAt, task: TaskAt, *, has_end: bool) -> tuple[str, Age | None]:
    """What keeps it from going on, or else what is to come. What is under it is shown, and named only where that leads
    to an end.
    """
    reasons = why_waiting(at, TaskId(task.id), with_children=False)
    with_children = has_end and not reasons
    reasons = why_waiting(at, TaskId(task.id)) if with_children else reasons
    ahead = coming(at, task)
    if reasons:
        more = f" ({'; '.join(ahead)})" if ahead else ""
        return printable(f"{waits_how(task)} {', and '.join(reasons)}{more}"), age(
            at, task, with_children=with_children
        )
    if task.suspension and task.handling:
        start, by = task.suspension.start, by_whom(task.suspension.by)
        return printable(f"still runs, though {at.describe(task.suspension.cause)} is suspended{by}"), Age(start, start)
    return printable("; ".join(ahead)), None


def _why_killed(at: RunAt, task: TaskAt) -> str:
    """Why, if that is not said of what it is under."""
    above = at.tasks.get(task.parent)
    return "" if above and above.why_killed == task.why_killed else printable(task.why_killed or "")


def _ending(at: RunAt, task: TaskAt) -> str:
    """What keeps a killed task from its end, and why it was killed."""
    if not (why := failure_line(task.failure)):
        why = f"killed: {why}" if (why := _why_killed(at, task)) else "killed"
    keeps = printable(", and ".join(why_waiting(at, TaskId(task.id))))
    return f"{why}; {keeps}" if keeps else why


def lasting(its_age: Age | None, time: float) -> str:
    """``, for 3.40 s`` and, if it waited for something else before, `` (8.00 s in all)``."""
    if its_age is None:
        return ""
    since, begun = its_age
    for_this = f", for {seconds(time - since)}" if since is not None and time - since >= _SHORTEST else ""
    is_all = since is not None and since - begun < _SHORTEST
    return for_this if is_all or time - begun < _SHORTEST else f"{for_this} ({seconds(time - begun)} in all)"


def _in_all(lasted: str) -> str:
    """In less room: ``, for 8.00 s in all``."""
    before, bracket, whole = lasted.partition(" (")
    return f", for {whole.removesuffix(')')}" if bracket else before


def failure_line(text: str) -> str:
    """A failure in one line: of a traceback, what comes before it."""
    first, *rest = text.strip().splitlines() or [""]
    return cut(printable(first), _LONGEST_FAILURE) + (" ..." if any(map(str.strip, rest)) else "")


def data(task: TaskAt) -> str:
    """Its data and result, or the data of its failure: ``{"leg": 2} -> {"z": 1.2}``, ``{"leg": 2} failed with 5``."""
    given, result, failure_data = map(data_text, (task.body, task.result, task.failure_data))
    return " ".join(filter(None, (given, result and f"-> {result}", failure_data and f"failed with {failure_data}")))


def folded(row: Row) -> str:
    """What a row says that stands for several tasks."""
    tasks = f"+ {row.folded} task{'s' * (row.folded != 1)}"
    if row.is_rest:
        return f"{tasks} further down"
    if 0 < row.killed < row.folded:
        return f"{tasks}: {row.folded - row.killed} {State.ACHIEVED}, {row.killed} {State.KILLED}"
    return f"{tasks} {row.state}"


def summary(at: Forest, *, is_live: bool = False) -> str:
    """``4.00 s, 8 tasks: 2 held, 1 achieving``; of a run that goes on, as of when."""
    counts = Counter(task.standing for task in at.tasks.values())
    states = ", ".join(f"{counts[standing]} {standing}" for standing in STANDINGS if counts[standing])
    total = f"{len(at.tasks)} task{'s' * (len(at.tasks) != 1)}"
    still = " (still running)" * is_live
    return f"{at.time:.2f} s{still}, {total}" + (f": {states}" if states else "")
