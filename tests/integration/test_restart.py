"""Central is killed and started anew, with real processes: what watches over the robot is there again, and first."""

import contextlib
import signal
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from subprocess import Popen

import pytest
from integration.programs import Central, central, program

from tca_module import CentralLost, Client, Command, Outcome, connect
from tca_tools.run.journals import open_log
from tca_wire.journal import facts

MOVE = Command("move", int)
CHECK = Command("check", int)
SOON = 30.0

COMMON = """
    from tca_module import *
    MOVE, CHECK, SLIP, STOP = Command("move", int), Command("check", int), Failure("slip"), ExceptionHandler("stop")
"""

LEGS = (
    COMMON
    + """
    module = Module("legs", requires=[CHECK])
    @module.handles(MOVE)
    def move(task: Task, number: int) -> None:
        if number < 0:
            raise SLIP()
    with module.running():
        print("ready", flush=True)
        import signal; signal.pause()
"""
)

SAFETY = (
    COMMON
    + """
    module = Module("safety")
    @module.handles(CHECK)
    def check(task: Task, number: int) -> None:
        print("check", number, flush=True)
    @module.handles(STOP)
    def stop(task: Task) -> None:
        print("stop", flush=True)
    @module.at_start
    def begin(module: Module) -> None:
        print("at start", flush=True)
        module.tap(Condition.BEFORE_HANDLING, MOVE, CHECK)
        module.on_failure(SLIP, STOP, of=MOVE)
    with module.running():
        print("ready", flush=True)
        import signal; signal.pause()
"""
)


class Running:
    """A robot, its first central and the one after it."""

    def __init__(self, folder: Path, first: Central, safety: "Popen[str]", user: Client) -> None:
        self.first, self.safety, self.user = first, safety, user
        self.folder = folder / "again"
        self.folder.mkdir()

    @contextmanager
    def restarted(self) -> Iterator[Central]:
        self.first.signal(signal.SIGKILL)
        self.first.process.wait()
        with central(self.folder, bind=self.first.address) as second:
            with contextlib.suppress(CentralLost):  # by this the user hears of it
                self.user.modules()
            yield second

    def said(self) -> str:
        """The next line of the program that watches."""
        assert self.safety.stdout
        return self.safety.stdout.readline().strip()


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[Running]:
    with ExitStack() as stack:
        first = stack.enter_context(central(tmp_path))
        safety = stack.enter_context(program(SAFETY, first.address))
        legs = stack.enter_context(program(LEGS, first.address))
        user = stack.enter_context(connect("user", first.address))
        running = Running(tmp_path, first, safety, user)
        assert (running.said(), running.said()) == ("at start", "ready")
        assert legs.stdout
        assert legs.stdout.readline() == "ready\n"
        yield running


def test_checks_and_exception_handlers_are_there_again_before_legs_move(robot: Running) -> None:
    assert robot.user.command(MOVE, 1).wait(SOON) is Outcome.DONE
    assert robot.said() == "check 1"
    with robot.restarted() as second:
        robot.user.wait_until_handled(MOVE, timeout=SOON)
        for number in (2, -3):
            assert robot.user.command(MOVE, number).wait(SOON) is Outcome.DONE
        assert [robot.said() for _ in range(3)] == ["check 2", "check -3", "stop"]
    told = [fact for entry in open_log(second.journal) for fact in entry.facts]
    order = [fact for fact in told if isinstance(fact, facts.TapAdded | facts.Attached | facts.HandlerAdded)]
    assert [type(fact) for fact in order[:2]] == [facts.TapAdded, facts.Attached]
    handled = [fact.message for fact in order if isinstance(fact, facts.HandlerAdded)]
    assert handled.index("check") < handled.index("move")
