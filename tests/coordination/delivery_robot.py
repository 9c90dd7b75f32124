"""A robot with a base, an arm and a gripper, and its delivery machine (figure 6 of the paper).

Runs use a clock that the test steps.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from tca_behaviours.coordination import (
    COORDINATION_EVENT,
    Activity,
    Agent,
    Coordination,
    CoordinationEnd,
    Coordinator,
    Discrete,
    Do,
    Fact,
    MachineEvent,
    Perceived,
    Policy,
    progress_only,
)
from tca_module import Client, Command, Failure, Module, SentTask, Task, Variable, connect
from tca_module.testing import LocalCentral
from tca_wire.charts import MachineChart
from tca_wire.coordination import read_report
from tca_wire.journal.facts import Killed, Received, Returned, StateChanged
from tca_wire.text.bodies import data_text

MOVE_BASE = Command("base to", str, progress=float)
MOVE_ARM = Command("arm to", str, progress=float)
GRIPPER = Command("gripper", str)
BOX_B_FREE = Variable("box B is free", float)
STUCK = Failure("stuck", float)
BASE, ARM, FINGERS = Agent("base"), Agent("arm"), Agent("gripper")
HOME = Do(MOVE_ARM, "home", ARM)
AT_HOME: dict[str, Fact] = {"base": "A", "arm": "home"}
AS_SOON_AS_LIKELY = Discrete(0.2, utility=lambda candidate: candidate.probability)
SECONDS = {MOVE_BASE.name: 8, MOVE_ARM.name: 3, GRIPPER.name: 1}


def base(place: str, **options: Any) -> Activity:
    return Activity(Do(MOVE_BASE, place, BASE), makes={"base": place}, **options)


def arm(place: str, **options: Any) -> Activity:
    return Activity(Do(MOVE_ARM, place, ARM), makes={"arm": place}, **options)


def opened(**needs: str) -> Activity:
    return Activity(Do(GRIPPER, "open", FINGERS), needs=needs)


def delivery(name: str = "deliver") -> Coordination:
    """Return a machine that goes from A to box B, or to box C if B is not free, and back."""
    with Coordination(name, facts=AT_HOME) as machine:
        waiting = machine.state("waiting")
        to_b = machine.state("going to B", base("B"))
        to_c = machine.state("going to C", base("C"))
        arm_b = machine.state("arm to box B", arm("box B"))
        arm_c = machine.state("arm to box C", arm("box C"))
        drop_b = machine.state("dropping in B", opened(base="B", arm="box B"))
        drop_c = machine.state("dropping in C", opened(base="C", arm="box C"))
        tuck = machine.state("tucking", arm("tuck"))
        back = machine.state("going back", base("A", needs={"arm": "tuck"}))
        end = machine.final("end")
        waiting.to(to_b, on="object given")
        to_b.to(arm_b, when=BOX_B_FREE, likelihood=Perceived(BOX_B_FREE))
        to_b.to(to_c, likelihood=Perceived(BOX_B_FREE, negated=True))
        to_c.to(arm_c)
        arm_b.to(drop_b)
        arm_c.to(drop_c)
        drop_b.to(tuck)
        drop_c.to(tuck)
        tuck.to(back)
        back.to(end)
    return machine


def make_robot(central: LocalCentral) -> Module:
    """Return a robot whose parts move for a fixed time, and report each half second. The place
    "stuck" is never reached.
    """
    robot = Module("robot", central)

    def move(task: Task, place: str) -> None:
        halves = 2 * SECONDS[task.message]
        for half in range(halves):
            task.sleep(0.5)
            if task.message != GRIPPER.name:
                task.report((half + 1) / halves)
            if place == "stuck":
                raise STUCK(0.5, "something is in the way")

    robot.handles(MOVE_BASE, resource="base")(move)
    robot.handles(MOVE_ARM, resource="arm")(move)
    robot.handles(GRIPPER, resource="gripper")(move)
    return robot


def make_driving_base() -> Module:
    """Return a robot whose base drives for 8 s. A test adds the other parts."""
    robot = Module("robot")

    @robot.handles(MOVE_BASE, resource="base")
    def drive(task: Task, _: str) -> None:
        task.sleep(8)

    return robot


ACCORDING_TO_PROGRESS = Discrete(0.25, utility=progress_only)


class Play:
    """A run of a machine on a stepped clock."""

    def __init__(
        self, central: LocalCentral, module: Module, coordinator: Coordinator, user: Client
    ) -> None:
        self.central = central
        self.module = module
        self.coordinator = coordinator
        self.user = user

    def begin(self, **options: Any) -> SentTask[CoordinationEnd]:
        run = self.user.command(self.coordinator.message, self.coordinator.chart, **options)
        self.central.until_quiet()
        return run

    def start(self, *events: str, seconds: float = 0) -> SentTask[CoordinationEnd]:
        """Start a run while box B is free. Post the events at once, then advance by *seconds*."""
        self.box_b(1.0)
        run = self.begin()
        for event in events:
            self.event(event)
        self.central.advance(seconds)
        return run

    def start_with_wrong_prediction(
        self, *events: str, seconds: float = 4, later: float = 30
    ) -> SentTask[CoordinationEnd]:
        """Start like start(). After *seconds*, box B is no longer free; advance by *later*."""
        run = self.start(*events, seconds=seconds)
        self.box_b(0.0)
        self.central.advance(later)
        return run

    def event(self, name: str) -> None:
        self.user.broadcast(COORDINATION_EVENT, MachineEvent(self.coordinator.machine.name, name))
        self.central.until_quiet()

    def box_b(self, free: float) -> None:
        self.user.set_variable(BOX_B_FREE, free)
        self.central.until_quiet()

    def event_lines(self) -> list[str]:
        """Return the events of the run's tasks with their times: roles, ends and transitions."""
        return list(_lines(self.central, self.coordinator.chart))


@contextmanager
def play(
    machine: Coordination,
    policy: Policy | None = ACCORDING_TO_PROGRESS,
    *others: Module,
    **options: Any,
) -> Iterator[Play]:
    with LocalCentral(stepped=True) as central:
        coordinator = Coordinator(machine, policy=policy, **options)
        module = Module("coordinator", central)
        coordinator.handle_in(module)
        robot = others[0] if others else make_robot(central)
        robot.central = central
        with robot.running(), module.running(), connect("user", central) as user:
            yield Play(central, module, coordinator, user)


def _lines(central: LocalCentral, chart: MachineChart) -> Iterator[str]:
    names: dict[int, str] = {}
    killed = set[int]()
    for entry in central.entries:
        at = f"{entry.time:g}"
        for fact in entry.facts:
            if isinstance(fact, Received) and fact.parent and fact.message in SECONDS:
                names[fact.id] = f"{fact.message} {data_text(fact.body).strip(chr(34))}"
            elif isinstance(fact, Returned) and fact.id in names and fact.id not in killed:
                yield f"{at} {names[fact.id]}: {fact.outcome}"
            elif isinstance(fact, Killed) and fact.task in names:
                killed.add(fact.task)
                yield f"{at} {names[fact.task]}: killed"
            elif isinstance(fact, StateChanged) and fact.task not in names:
                report = read_report(fact.body)
                if report is None:
                    continue
                if report.taken:
                    yield f"{at} -> {chart.states[report.current].label} ({report.taken})"
                yield from (f"{at} {names[change.task]}: {change.role}" for change in report.news)
