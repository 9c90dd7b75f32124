"""Random lives in which clients and handlers change the states of tasks.

The invariants hold, everything ends, and observers see the states that the tables allow.
"""

from collections import defaultdict

import pytest
from central.test_random_lives import end_everything
from central.transcript import PAUSABLE
from hypothesis import example, given, settings
from hypothesis import strategies as st
from properties.life_of_states import LifeOfStates
from properties.oracle_states import Reference, TrackedTask
from sampling import lives

from tca_wire.journal import facts
from tca_wire.life_cycles import Effect
from tca_wire.packets import headers
from tca_wire.packets.parts import StateChange
from tca_wire.points import TaskId
from tca_wire.vocabulary import Busy, Outcome, Party


class JudgedLife(LifeOfStates):
    """A life that compares all states with the reference after each operation."""

    def __init__(self) -> None:
        self.reference = Reference()
        super().__init__()
        self.read = 0
        self.judge()

    def do(self, name: str, a: int, b: int, c: int, d: int) -> None:
        """Do one operation, and compare all states."""
        self.asked = None
        super().do(name, a, b, c, d)
        self.judge()

    def judge(self) -> None:
        if self.asked is not None:
            self.note(self.asked.entries)
            self.reference.ask(self.asked)
        self.note(len(self.player.entries))
        for task in self.central.tree.tasks.values():
            if not task.message.message_class.is_monitor:
                followed = self.reference.tasks[task.id]
                found, expected = (task.state, task.serial), (followed.state, followed.serial)
                assert found == expected, (str(task), found, followed.changes, self.asked)
                assert task.body == followed.goal, (str(task), self.asked)

    def note(self, until: int) -> None:
        self.reference.note(
            fact for entry in self.player.entries[self.read : until] for fact in entry.facts
        )
        self.read = until

    def judge_observed_changes(self) -> None:
        """Check that the observer saw all changes of each task in order, and one end."""
        seen: dict[int, list[StateChange]] = defaultdict(list)
        for change in self.seen():
            assert not change.is_late
            seen[change.task].append(change)
        for number, task in self.reference.tasks.items():
            changes = seen[number]
            if task.is_over:
                *changes, end = changes
                assert end.is_over
                assert end.serial == task.serial + 1
                assert task.cycle.is_over(end.state)
                is_kill = end.by is Party.CENTRAL
                ways = [
                    one.name
                    for one in task.cycle.transitions
                    if (one.source, one.target) == (task.state, end.state)
                    and (one.effect is Effect.STOP) is is_kill
                ]
                if end.outcome is Outcome.RESOLVED:
                    ways = [str(end.outcome)]
                assert end.transition in (
                    ways or (["killed"] if is_kill else ["completed", "failed"])
                )
            assert [(one.transition, one.state, one.serial) for one in changes] == task.changes


class BusyLife(LifeOfStates):
    """A life in which busy handlers queue, reject or are pre-empted."""

    busy = (Busy.QUEUE, Busy.PREEMPT, Busy.REJECT)


def end_life_of_states(life: LifeOfStates) -> None:
    """End all tasks, and check that no request is left open."""
    life.player.receive("user", headers.GiveUp(life.observing))
    end_everything(life)
    assert not life.central.dispatcher.running
    assert not any(
        connection.outstanding for connection in life.central.registry.connections.values()
    )


def judge_life(seed: int, events: int) -> None:
    life = JudgedLife()
    life.go_on(seed, events)
    life.judge_observed_changes()
    end_life_of_states(life)


def test_request_stays_open_while_an_exception_handler_decides() -> None:
    """Another failure, raised beside the handler, remains unhandled before that decision."""
    reference, one = Reference(), TaskId(1)
    reference.tasks = {number: TrackedTask(PAUSABLE, b"") for number in (1, 2, 3)}
    task = reference.tasks[one]
    cancel = task.row("initiated", "cancel", Party.CLIENT)
    assert cancel is not None
    task.open.append((cancel, 1, b""))
    reference.note([facts.Failed(one, "slipped", ""), facts.Caught(one, TaskId(2), one, 9)])
    reference.note([facts.Caught(one, TaskId(3), one, 9, is_beside=True)])
    reference.note([facts.Killed(TaskId(3), ""), facts.Unhandled(one)])
    with pytest.raises(AssertionError, match="no answer"):
        reference.note([facts.Reissued(TaskId(2)), facts.Unhandled(one)])


@given(st.integers(0, 1 << 32))
@example(1406319357)  # a handler accepts with a goal of its own
@example(1395)  # an exception handler resolves a failure
@settings(max_examples=lives(3, soak=150))
def test_task_states_match_the_life_cycle_tables(seed: int) -> None:
    judge_life(seed, lives(200, soak=800))


@given(st.integers(0, 1 << 32))
@settings(max_examples=lives(3, soak=150))
def test_everything_ends_when_handlers_reject_or_are_preempted(seed: int) -> None:
    life = BusyLife()
    life.go_on(seed, lives(150, soak=600))
    end_life_of_states(life)
