"""Why a task does not go on, in plain words. Asks what was known; changes nothing."""

from bisect import bisect_right
from collections.abc import Iterator
from itertools import islice
from operator import itemgetter
from typing import NamedTuple

from tca_tools.analysis import words
from tca_tools.run.at_time import RunAt, TaskAt
from tca_tools.run.records import Ahead, Hold, State
from tca_tools.why.whereabouts import NAMED, claim_and_why, kept_busy, listed, whereabouts
from tca_wire.points import ROOT, Moment, Point, TaskId, describe_moments
from tca_wire.rules import NO_LATER
from tca_wire.text.facts_in_words import by_whom, place
from tca_wire.vocabulary import Role, Scope

_CLAUSES = {
    Moment.START_HANDLING: "is being handled",
    Moment.END_HANDLING: "has been handled",
    Moment.START_PLANNING: "is being planned",
    Moment.END_PLANNING: "is planned",
    Moment.START_ACHIEVING: "is being achieved",
    Moment.END_ACHIEVING: "is achieved",
}
_OF_FAMILY = (Moment.START_PLANNING, Moment.START_ACHIEVING)
"""The moments that a task reaches only after its parent has."""
_NEXT = {
    State.HELD: (Moment.START_HANDLING,),
    State.PLANNED: (Moment.START_ACHIEVING,),
    State.PLANNING: (Moment.END_HANDLING, Moment.END_PLANNING),
    State.ACHIEVING: (Moment.END_HANDLING, Moment.END_PLANNING, Moment.END_ACHIEVING),
}
"""The moments that a task may be kept from."""
UNTIL_CHILDREN = {State.PLANNING: Moment.END_PLANNING, State.ACHIEVING: Moment.END_ACHIEVING}
"""States in which a task waits for what is under it, and until what has come."""


class Until(NamedTuple):
    """A reason: that some tasks have not come to one and the same moment yet."""

    tasks: tuple[int, ...]
    names: tuple[str, ...]
    """Of the first ones."""
    what: str
    """What they do then: "is achieved"."""

    def __str__(self) -> str:
        """``until bake {3}, bake {4}, bake {5} and 24 more are achieved``."""
        return f"until {listed(self.names, len(self.tasks))} {of_all(self.what, len(self.tasks))}"

    def goes_on_in(self, later: "Reason") -> bool:
        """Whether that is the same with some less, and yet with more than are named: no news to tell."""
        if not isinstance(later, Until) or later.what != self.what or len(later.tasks) <= NAMED:
            return False
        return set(later.tasks) <= set(self.tasks)

    def is_part_of(self, earlier: "Reason") -> bool:
        """Whether all of them were waited for then, too."""
        return isinstance(earlier, Until) and earlier.what == self.what and set(self.tasks) <= set(earlier.tasks)


Reason = Until | str


def why_waiting(at: RunAt, task_id: TaskId, *, with_children: bool = True) -> list[str]:
    """What keeps a task waiting: ``["until take steps {2} is achieved"]``; nothing if it is over or unknown. All tools
    ask here. What is said goes after ``waits_how``.
    """
    return list(map(str, reasons_of(at, task_id, with_children=with_children)))


def reasons_of(at: RunAt, task_id: TaskId, *, with_children: bool = True) -> list[Reason]:
    """The same, with all tasks that are waited for, of which only the first are named."""
    task = at.tasks.get(task_id)
    reasons = _REASONS.get(task.state) if task else None
    if not task or not reasons:
        return []
    found = list(dict.fromkeys(reasons(at, task)))
    if with_children and (awaited := awaited_children(at, task)):
        found.append(awaited)
    return found


def awaited_children(at: RunAt, task: TaskAt) -> Until | None:
    """The tasks under a task, if it waits for them."""
    return _of_children(at, task, UNTIL_CHILDREN[task.state]) if awaits_children(task) else None


def awaits_children(task: TaskAt) -> bool:
    """Whether a task waits for what is under it, if anything is: no handler has it any more, and it watches nothing."""
    return task.state in UNTIL_CHILDREN and not task.handling and not task.watches


def waits_how(task: TaskAt) -> str:
    """What goes before the reasons of a task: "waits", "suspended by operator panel,", "asked", "killed,"."""
    if task.state is State.ENDING:
        return "killed,"
    if task.watches:
        return "watches:"
    if task.handling and not task.wait and task.asking:
        return "asked"
    by = task.suspension.by if task.state is State.SUSPENDED and task.suspension else ""
    return f"suspended{by_whom(by)}," if by_whom(by) else "waits"


def waits_since(task: TaskAt) -> float:
    """From when on a task has waited for that: since its handler blocks or asked, since it is suspended, since an
    exception handler was called for its failure, since it is in its queue, or since its state.
    """
    if task.state is State.RECOVERING:
        return task.since if task.called is None else max(task.called, task.since)
    if task.state is State.SUSPENDED and task.suspension:
        return task.suspension.start
    if task.state is State.QUEUED and task.queueing:
        return task.queueing.start
    if task.state is State.ENDING or task.watches or not task.handling:
        return task.since
    return task.wait.start if task.wait else next((one.received for one in task.asking), task.since)


def coming(at: RunAt, task: TaskAt) -> list[str]:
    """What is to happen to a task at a time or after a point, in words: ``deadline: end achieving by 9.5 s``."""
    return [said for one in task.ahead if (said := of_ahead(at, task, one))]


def of_ahead(at: RunAt, task: TaskAt, ahead: Ahead) -> str:
    """One of them; "" if it is not to come any more."""
    if ahead.moment is not None:
        due = ahead.set_at + ahead.seconds
        is_to_come = ahead.moment not in task.reached and due > at.time
        return f"deadline: {describe_moments(ahead.moment)[0]} by {words.moment(due)}" if is_to_come else ""
    who = f"{_SCOPES[ahead.scope]} to be killed{by_whom(ahead.by)}"
    if ahead.after is not None and not at.has_reached(ahead.after):
        later = f"{words.seconds(ahead.seconds)} after" if ahead.seconds else "when"
        return f"{who} {later} {at.describe(ahead.after.task)} {clause(ahead.after.moment)}"
    since = max(ahead.set_at, (at.reached_at(ahead.after) or ahead.set_at) if ahead.after else ahead.set_at)
    due = since + ahead.seconds
    return f"{who} at {words.moment(due)}" if due > at.time else ""


_SCOPES = {Scope.TASK: "is", Scope.DESCENDANTS: "what is under it is", Scope.SIBLINGS: "its siblings are"}


def clause(moment: Moment) -> str:
    """What a task does when it reaches a moment: "is achieved"."""
    return _CLAUSES[moment]


def of_all(what: str, number: int) -> str:
    """The same of several: "are achieved", "have been handled", "were killed"."""
    verb, _, rest = what.partition(" ")
    return what if number == 1 or verb not in _OF_SEVERAL else f"{_OF_SEVERAL[verb]} {rest}"


_OF_SEVERAL = {"is": "are", "has": "have", "was": "were"}


def _of_held_back(at: RunAt, task: TaskAt) -> Iterator[Reason]:
    """Tasks that are waited for until the same moment are told together, where the first of them is."""
    found: dict[Moment | str, dict[TaskId, None]] = {}
    for blocker in blockers(at, task):
        if (point := _plain(blocker)) is not None:
            found.setdefault(point.moment, {})[point.task] = None
        else:
            found[of_blocker(at, task, blocker)] = {}
    for one, tasks in found.items():
        if isinstance(one, Moment):
            names = tuple(_described(at, task) for task in islice(tasks, NAMED))
            yield Until(tuple(tasks), names, _CLAUSES[one])
        else:
            yield one


def _plain(blocker: Hold | Moment) -> Point | None:
    """The point that has to be reached, if that is all there is to it: no delay, no wiretap, no parent."""
    if isinstance(blocker, Moment) or blocker.tap or blocker.constraint.delay:
        return None
    return None if blocker.constraint.before.task == ROOT else blocker.constraint.before


def _of_queued(at: RunAt, task: TaskAt) -> Iterator[str]:
    queueing = task.queueing
    if not queueing or not queueing.module:
        yield f"for a module that handles {task.name}"
        return
    why = kept_busy(at, queueing.module, queueing.resource, task)
    yield f"for {place(queueing.module, queueing.resource)}" + (f", {why}" if why else "")


def of_handler(at: RunAt, task: TaskAt) -> Iterator[str]:
    """A handler that runs may block, or go on while it waits for replies."""
    waits = task.waits
    for wait in waits:
        if wait.moment:
            yield _until(at, Point(TaskId(wait.awaited), wait.moment))
        elif wait.awaited in at.run.claims:
            yield f"for the {claim_and_why(at, at.run.claims[wait.awaited])}"
        else:
            yield f"for the reply to {at.describe(wait.awaited)}{whereabouts(at, wait.awaited)}"
    if not waits and (asking := task.asking):
        yield f"{listed([str(one) for one in asking])}{whereabouts(at, asking[0].id)}, no reply yet"


def _of_planning(at: RunAt, task: TaskAt) -> Iterator[Reason]:
    if task.handling:
        yield from of_handler(at, task)
        return
    yield from _of_held_back(at, task)


def _of_achieving(at: RunAt, task: TaskAt) -> Iterator[Reason]:
    if task.watches:
        yield _of_watching(at, task)
        return
    yield from _of_held_back(at, task)


def _of_watching(at: RunAt, monitor: TaskAt) -> str:
    tests = at.run.tests.get(monitor.id, [])
    last = tests[: bisect_right(tests, at.moment, key=itemgetter(0))][-1:]
    if not last:
        return "its condition has not been tested" if _has_condition(monitor) else "it has not been fired"
    return f"its condition {'holds' if last[0][1] else 'does not hold'}"


def _has_condition(monitor: TaskAt) -> bool:
    return monitor.message_class.has_condition


def _of_ending(at: RunAt, task: TaskAt) -> Iterator[str]:
    """A killed task ends when its handler has returned, and with what is done to leave things safe."""
    if task.handling:
        blocked = "".join(f", and waits {what}" for what in of_handler(at, task)) if task.wait else ""
        yield f"its handler still runs{blocked}"
    if awaited := _of_children(at, task, Moment.END_ACHIEVING):
        yield f"waits {awaited}"
    if task.suspension and not task.handling:
        yield f"waits until {at.describe(task.suspension.cause)} is resumed"


def _of_children(at: RunAt, task: TaskAt, moment: Moment) -> Until | None:
    if task.is_retried:  # all under it ends first
        moment = Moment.END_ACHIEVING
    open_ones = tuple(child for child in task.children if not at.has_reached(Point(child, moment)))
    is_over = task.is_retried or task.state is State.ENDING  # however they end
    names = tuple(_below(at, task, child) for child in open_ones[:NAMED])
    return Until(open_ones, names, "has ended" if is_over else _CLAUSES[moment]) if open_ones else None


def _below(at: RunAt, task: TaskAt, number: TaskId) -> str:
    """A task under another; of what is to be handled again also that a wiretap of it is why that one is there."""
    child = at.run.tasks[number]
    is_listener = task.is_retried and child.role is Role.LISTENER and child.about == task.id
    return f"{child} (the listener of a wiretap)" if is_listener else str(child)


def blockers(at: RunAt, task: TaskAt) -> Iterator[Hold | Moment]:
    """What keeps a task that no handler has from what it would reach next: constraints that are not met yet, and
    moments that its parent has to reach first.
    """
    moments = list(_NEXT.get(task.state, ()))
    if task.state is State.RECOVERING and Moment.START_HANDLING not in task.reached:
        moments += _NEXT[State.HELD]
    if moments == [Moment.START_HANDLING]:
        moments.append(Moment.START_PLANNING if task.message_class.is_goal else Moment.START_ACHIEVING)
    yield from blockers_of(at, task, moments)


def up_to(task: TaskAt, moment: Moment) -> list[Moment]:
    """The moments that a task has to reach before that one, and that one, unless it has."""
    reached = task.reached
    before = NO_LATER[task.message_class.is_goal][moment]
    return [one for one in Moment if one & before and one not in reached]


def blockers_of(at: RunAt, task: TaskAt, moments: list[Moment]) -> Iterator[Hold | Moment]:
    """What keeps a task from these moments. A wait for a moment of its own, which is added to them, leads on to what
    keeps it from that.
    """
    for moment in moments:  # grows while it is walked
        for hold in task.holds:
            before = hold.constraint.before
            if hold.constraint.after.moment != moment or _is_met(at, task, hold):
                continue
            if before.task != task.id or (hold.constraint.delay and at.has_reached(before)):
                yield hold
            elif before.moment not in moments:
                moments += [one for one in up_to(task, before.moment) if one not in moments]
        if moment in _OF_FAMILY and not task.role and not at.has_reached(Point(task.parent, moment)):
            yield moment


def held_above(at: RunAt, task: TaskAt) -> Iterator[tuple[TaskAt, Hold]]:
    """The constraints of tasks above that keep it from what it would reach next, each with whose it is."""
    moments = [one for one in blockers(at, task) if isinstance(one, Moment)]
    while moments and task.parent in at.tasks:
        task = at.tasks[task.parent]
        found = list(blockers_of(at, task, list(dict.fromkeys(one for last in moments for one in up_to(task, last)))))
        yield from ((task, one) for one in found if isinstance(one, Hold))
        moments = [one for one in found if isinstance(one, Moment)]


def of_blocker(at: RunAt, task: TaskAt, blocker: Hold | Moment) -> str:
    """One of them in words: ``until move {4} is achieved``."""
    if isinstance(blocker, Moment):
        return f"until its parent {at.describe(task.parent)} {_CLAUSES[blocker]}"
    before, delay = blocker.constraint.before, blocker.constraint.delay
    if before.task == ROOT:
        return f"until {words.moment(delay)}"
    if tap := blocker.tap:
        whose = f"of a wiretap of {tap.by}" if tap.by else "of a wiretap"
        return f"until {at.describe(before.task)}, the listener {whose}, {_CLAUSES[before.moment]}"
    return _until(at, before, f"{words.seconds(delay)} after " if delay else "")


def _is_met(at: RunAt, task: TaskAt, hold: Hold) -> bool:
    return task.is_over(hold) if hold.constraint.delay else at.has_reached(hold.constraint.before)


def _until(at: RunAt, point: Point, delay: str = "") -> str:
    return f"until {delay}{_described(at, point.task)} {_CLAUSES[point.moment]}"


def _described(at: RunAt, number: TaskId) -> str:
    task = at.run.tasks.get(number)
    kind = (
        f"{'monitor' if task.message_class.is_monitor else 'task'} " if task and task.name.startswith("until ") else ""
    )
    return f"{kind}{at.describe(number)}"


def _of_suspended(at: RunAt, task: TaskAt) -> Iterator[Reason]:
    """What was suspended may be far above; and handlers under this one may still run."""
    if running := tuple(run.message_id for run in at.ran_on(task)):
        yield Until(running, tuple(map(at.describe, running[:NAMED])), _CLAUSES[Moment.END_HANDLING])
    if task.suspension:
        yield f"until {at.describe(task.suspension.cause)} is resumed"


def dealing(at: RunAt, task: TaskAt, what: str = "its failure") -> str:
    """Who takes care of a task's failure: ``until recover {5} has dealt with its failure``."""
    handlers = [str(at.tasks[handler]) for handler in task.caught_by[-1:] if handler in at.tasks]
    return f"until {handlers[0]} has dealt with {what}" if handlers else f"until somebody has dealt with {what}"


def _of_recovering(at: RunAt, task: TaskAt) -> Iterator[Reason]:
    yield dealing(at, task)
    if task.suspension and not task.handling:
        yield f"until {at.describe(task.suspension.cause)} is resumed"
    if task.queueing:
        yield from _of_queued(at, task)
    elif task.handling:
        yield from of_handler(at, task) if task.wait else ()
    else:
        yield from _of_held_back(at, task)


_REASONS = {
    State.HELD: _of_held_back,
    State.SUSPENDED: _of_suspended,
    State.RECOVERING: _of_recovering,
    State.QUEUED: _of_queued,
    State.PLANNING: _of_planning,
    State.PLANNED: _of_held_back,
    State.HANDLING: of_handler,
    State.ACHIEVING: _of_achieving,
    State.ENDING: _of_ending,
}
