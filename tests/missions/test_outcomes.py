"""A run that did not complete has failed, or was killed, for clients, observers and the journal."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import msgspec
import pytest
from missions.rover import rover
from msgspec.structs import replace
from tools.runs import checked

from tca_behaviours.missions import (
    Environment,
    Mission,
    MissionTaskFailed,
    OnceTask,
    Status,
    TaskEnd,
    TaskServer,
)
from tca_module import Command, Failure, Module, Outcome, Task, connect
from tca_module.testing import LocalCentral
from tca_tools.check.rules import MISSION
from tca_tools.journal.fold import History
from tca_tools.journal.lives import life_at
from tca_tools.journal.records import TaskState
from tca_wire.journal import facts

FAILURES: list[dict[str, Any]] = [
    {"fails": "rock"},
    {"fails": "never", "task_timeout": 0.02},
    {"fails": "initialise"},
]
Ends = list[tuple[str, str]]


@contextmanager
def mission_with_every_end() -> Iterator[tuple[LocalCentral, Mission, Ends]]:
    """Let three drives fail, stop one, and let one complete. Yield their ends as an observer sees
    them.
    """
    with (
        rover() as (central, _),
        connect("eye", central) as eye,
        Mission("rover", central=central) as mission,
    ):
        with eye.observe(eye.declared("rover.Drive")) as changes:
            for parameters in FAILURES:
                with pytest.raises(MissionTaskFailed):
                    mission.Drive(**parameters)
            mission.stop_task(mission.start("Drive", fails="never"))
            mission.Drive()
            ends = [
                (change.transition, change.state)
                for _, change in zip(range(15), changes, strict=False)
            ]
        yield central, mission, ends[2::3]


def test_task_outcome_agrees_for_observer_client_and_journal() -> None:
    with mission_with_every_end() as (central, mission, ends):
        outcomes = [task.sent.wait(0) for task in mission.ended]
    assert ends == [("failed", "cancelled")] * 3 + [("killed", "cancelled"), ("completed", "done")]
    assert outcomes == [*[Outcome.FAILED] * 3, Outcome.KILLED, Outcome.DONE]
    run = History.until(central.entries)
    tasks = [task for task in run.tasks.values() if task.name == "rover.Drive"]
    assert [task.state for task in tasks] == [
        *[TaskState.FAILED] * 3,
        TaskState.KILLED,
        TaskState.ACHIEVED,
    ]
    assert [life_at(run, task).state for task in tasks] == [state for _, state in ends]
    assert checked(central.entries) == []


def as_recovered(entry: facts.Entry, failed: facts.Caught) -> list[facts.Fact]:
    """Return the facts as if the mission's exception handler had recovered the failure."""
    kept = [
        fact
        for fact in entry.facts
        if not (isinstance(fact, facts.Killed) and fact.task == failed.task)
    ]
    has_returned = any(
        isinstance(fact, facts.Returned) and fact.id == failed.handler for fact in kept
    )
    return [*kept, facts.Recovered(failed.task)] if has_returned else kept


def as_completed(entry: facts.Entry, failed: facts.Caught) -> list[facts.Fact]:
    """Return the facts as if the handler had returned a status that is not COMPLETED."""
    end = msgspec.msgpack.encode(TaskEnd(Status.FAILED | Status.TERMINATED))
    returned = [
        fact for fact in entry.facts if isinstance(fact, facts.Returned) and fact.id == failed.task
    ]
    return [
        replace(fact, outcome=Outcome.DONE, body=end) if fact in returned else fact
        for fact in entry.facts
    ]


@pytest.mark.parametrize("bend", [as_recovered, as_completed])
def test_check_reports_a_failed_run_counted_as_done(
    bend: Callable[..., list[facts.Fact]],
) -> None:
    with mission_with_every_end() as (central, *_):
        pass
    failed = next(fact for fact in central.facts if isinstance(fact, facts.Caught))
    bent = [replace(entry, facts=bend(entry, failed)) for entry in central.entries]
    found = [one.message for one in checked(bent) if one.rule == MISSION.text]
    assert found == [failed.task]


STEP, SLIPS = Command("step"), Failure("slips")


class Nap(OnceTask[Environment]):
    def iterate(self) -> None:
        self.sleep(1000.0)


class Walk(OnceTask[Environment]):
    def iterate(self) -> None:
        self.task.command(STEP)


def slip(_: Task) -> None:
    raise SLIPS(text="on ice")


@pytest.mark.parametrize(
    ("task", "timeout", "text"),
    [("Nap", 0.01, r"timeout: it ran"), ("Walk", 0.0, r"failed: slips: in step \{\d+\}: on ice")],
)
def test_task_fails_at_timeout_or_with_its_subtask(task: str, timeout: float, text: str) -> None:
    with (
        LocalCentral() as central,
        TaskServer("dog", Environment(), [Nap, Walk], central=central).running(),
    ):
        legs = Module("legs", central)
        legs.handles(STEP)(slip)
        with legs.running(), Mission("dog", central=central) as mission:
            with pytest.raises(MissionTaskFailed, match=text):
                mission.run(task, task_timeout=timeout)
