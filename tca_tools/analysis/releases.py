"""What let a task go on, link by link: by way of its parent and of constraints, all at one event. Pure."""

from collections.abc import Iterator
from math import nextafter

from tca_tools.run.at_time import RunAt
from tca_tools.run.records import Hold, Task
from tca_tools.run.whole_run import Run
from tca_tools.why.waiting import blockers, of_blocker
from tca_wire.points import Moment, TaskId
from tca_wire.text.facts_in_words import kill_reason

_LINKS = 6
"""How many are told."""


def released_by(at: RunAt, task: Task, time: float) -> Iterator[tuple[str, Task]]:
    """What a task was held by just before the event of a time, and is no longer: in words, and the task that it is
    about.
    """
    if (before := at.tasks.get(TaskId(task.id))) is None:
        return
    for blocker in blockers(at, before):
        number, moment = _point(task, blocker)
        other = at.run.tasks.get(number)
        if other is not None and other.reached.get(moment) == time:
            yield of_blocker(at, before, blocker), other


def released(run: Run, task: Task, time: float) -> str:
    """``; clean {3} waited until walk {2} is achieved; walk {2} was killed: ...``: why what a task waited for came
    just then, after what is said of the task itself; "" if there is nothing to add.
    """
    at = RunAt(run, nextafter(time, 0.0))
    told: list[str] = []
    seen = {task.id}
    found = next(released_by(at, task, time), None)
    while found is not None and len(seen) <= _LINKS and (other := found[1]).id not in seen:
        seen.add(other.id)
        if (found := next(released_by(at, other, time), None)) is not None:
            told.append(f"{other} waited {found[0]}")
        elif other.killed is not None and other.written("killed") == time:
            told.append(f"{other} was killed: {kill_reason(other.killed, other.killed_by)}")
    return "".join(f"; {one}" for one in told)


def _point(task: Task, blocker: Hold | Moment) -> tuple[int, Moment]:
    if isinstance(blocker, Moment):
        return task.parent, blocker
    return blocker.constraint.before.task, blocker.constraint.before.moment
