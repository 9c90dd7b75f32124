"""Random use of a task server.

Under any sends, kills and updates, one run has the foreground, and each initialised run is
terminated once.
"""

from collections import Counter
from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from missions.gripper import Gripper, Robot, serving

from tca_behaviours.missions import Idle, OnceTask, PeriodicTask, Status
from tca_module import Refused, Rejected, SentTask

SECONDS = st.sampled_from([0.0, 0.05, 0.1, 0.25])


class Recorded:
    """A task that records when a run begins and ends."""

    env: Gripper
    task: Any
    foreground: bool
    dies_in: str = ""
    ends_after: float = 0.0

    def note(self, what: str) -> None:
        self.env.notes.append(f"{what} {self.task.id} {self.foreground}")

    def initialise(self) -> None:
        if self.dies_in == "initialise":
            raise ValueError(self.dies_in)
        self.note("begins")

    def terminate(self) -> None:
        self.sleep(self.ends_after)  # type: ignore[attr-defined]
        self.note("ends")
        if self.dies_in == "terminate":
            raise ValueError(self.dies_in)


class Work(Recorded, PeriodicTask[Gripper]):
    left: int = 3

    def iterate(self) -> Status:
        self.left -= 1
        if self.dies_in == "iterate":
            raise ValueError(self.dies_in)
        return Status.RUNNING if self.left > 0 else Status.COMPLETED


class Sleep(Recorded, OnceTask[Gripper]):
    seconds: float = 0.3

    def iterate(self) -> None:
        self.sleep(self.seconds)


STARTS = st.tuples(
    st.sampled_from(["Work", "Sleep"]),
    st.fixed_dictionaries(
        {},
        optional={
            "foreground": st.booleans(),
            "dies_in": st.sampled_from(["initialise", "iterate", "terminate"]),
            "ends_after": SECONDS,
            "task_timeout": SECONDS,
        },
    ),
)
ACTS = st.lists(
    st.one_of(
        STARTS, SECONDS, st.tuples(st.sampled_from(["kill", "cancel", "update"]), st.integers(0, 5))
    )
)


def carry_out(robot: Robot, what: Any, sent: list[SentTask[Any]]) -> None:
    """Carry out one random act."""
    if isinstance(what, float):
        robot.central.advance(what)
        return
    call, more = what
    if call in ("Work", "Sleep"):
        sent.append(robot.send(call, **more))
    elif sent:
        task = sent[more % len(sent)]
        try:
            if call == "kill":
                task.kill("at random")
            elif call == "cancel":
                task.cancel()
            else:
                task.update_send(
                    robot.server.definitions[task.message.partition(".")[2]].parameters(
                        task_timeout=0.5
                    )
                )
        except (Refused, Rejected):
            pass  # already ended


@given(ACTS)
def test_foreground_is_exclusive_in_random_runs(acts: list[Any]) -> None:
    sent: list[SentTask[Any]] = []
    with serving(Work, Sleep, idle=Idle, capacity=5) as robot:
        for what in acts:
            carry_out(robot, what, sent)
        robot.central.advance(20)
        assert [task.message for task in robot.user.tasks()] == ["gripper.Idle"]
        assert [type(run.served) for run in robot.server.runs] == [Idle]
    holder: str = ""
    for note in robot.gripper.notes:
        what, task, foreground = note.split()
        if foreground == "True":
            assert holder == ("" if what == "begins" else task), robot.gripper.notes
            holder = task if what == "begins" else ""
    begun = Counter(note.split()[1] for note in robot.gripper.notes if note.startswith("begins"))
    ended = Counter(note.split()[1] for note in robot.gripper.notes if note.startswith("ends"))
    assert begun == ended
