"""What let a task go on, link by link: the waits that ended at one event, by way of parents and constraints."""

from collections.abc import Iterator
from math import nextafter

from tca_tools.run.at_time import RunAt
from tca_tools.run.records import Task
from tca_tools.run.whole_run import Run
from tca_tools.why.wait_words import told
from tca_tools.why.waits import Wait, waits_of
from tca_wire.text.facts_in_words import kill_reason
from tca_wire.text.waits_in_words import several_in_words
from tca_wire.waits import WaitKind

_LINKS = 6
"""How many are told."""


def ended_at(run: Run, task: Task, time: float) -> list[Wait]:
    """The waits of a task that were over at a time, and had begun before: not those for its handler and its subtasks,
    through which a path goes anyhow.
    """
    waits = (wait for wait in waits_of(run, task.id) if wait.kind not in (WaitKind.RUNNING, WaitKind.SUBTASK))
    return [wait for wait in waits if wait.end == time and wait.start < time]


def in_words(run: Run, waits: list[Wait], time: float) -> str:
    """Waits that ended at a time, as they were just before."""
    return several_in_words(told(RunAt(run, nextafter(time, 0.0)), waits))


def released(run: Run, task: Task, time: float) -> str:
    """``; clean {3} waited until walk {2} is achieved; walk {2} was killed: ...``: why what a task waited for came
    just then, after what is said of the task itself; "" if there is nothing to add.
    """
    return "".join(f"; {link}" for link in _links(run, task, time))


def _links(run: Run, task: Task, time: float) -> Iterator[str]:
    seen = {task.id}
    waits = ended_at(run, task, time)
    while waits and len(seen) <= _LINKS:
        other = next((run.tasks[one.on.number] for one in waits if one.on.number in run.tasks), task)
        if other.id in seen:
            return
        seen.add(other.id)
        if other.killed is not None and other.written("killed") == time:
            yield f"{other} was killed: {kill_reason(other.killed, other.killed_by)}"
            return
        if waits := ended_at(run, other, time):
            yield f"{other} waited {in_words(run, waits, time)}"
