"""The cost of an event does not grow with the task tree. Each request takes as many steps in a
deep or wide tree, or beside many monitors, wiretaps and waits, as in a small one.

A step is one executed line of central's code. A call of a C function counts as one step.
Requests that must visit every descendant are left out: kill, suspend and retry of a wide task.
A failure searches for exception handlers up to the root (decision 112).
"""

import re
import sys
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import pytest
from central.player import IN_PYTHON
from central.transcript import Transcript

import tca_central

CENTRAL_FOLDER = str(Path(tca_central.__file__).parent)
FEW, MANY = 15, 200
LEEWAY = 120
"""Extra steps that are no growth: occasional sweeps, and the logarithm of a heap's size."""

START = """
    module planner handles goal walk
    module legs handles command move, command halt, query where, inform note
    module helper handles exception handler help, command check, query seen
    module user
    module other
    user: declare polling monitor watch of seen, none
    user: goal walk
    user: command move under {new} from outside flags NONE
"""


class Robot(Transcript):
    def __init__(self) -> None:
        super().__init__()
        self.player.check = False
        self.at = 0  #: the task under which commands act
        self.do(START)
        self.at = 1

    @property
    def newest(self) -> int:
        return next(reversed(self.player.central.tree.tasks), 0)

    def do(self, text: str) -> None:
        for line in filter(None, map(str.strip, text.splitlines())):
            output = self.play(
                line.format(at=self.at, new=self.newest, number=self.player.central.tree.newest)
            )
            assert not re.search("refused|ignored", output), f"{line}: {output}"


WORLDS: dict[str, tuple[str, str]] = {
    # each goal is sent under the goal before it
    "deep": ("", "planner: goal walk under {at} from outside\nplanner/1: reply"),
    "wide": ("", "planner: command move under {at} from outside flags NONE"),
    "wide above": ("", "other: command move flags NONE"),
    "in sequence": ("", "planner: command move under {at} from outside"),
    "watched": (
        "planner: command halt under {at} from outside",
        "user: polling monitor watch under {at} every 1000000 from outside waited for",
    ),
    "waited for": ("", "other: wait end achieving {at}"),
    "kept": ("legs/1: reply", "planner: command halt under {at} from outside kept\nlegs/1: reply"),
    "tapped": ("", "other: tap when killed of {at} with check"),
}
"""Two texts for each world: the commands that are played once, and those that are repeated."""

ROUNDS = {
    title: commands
    for title, *commands in map(
        str.splitlines, Path(__file__).with_name("rounds.txt").read_text().split("\n\n")
    )
}


class Steps:
    """A counter of executed lines of central's code."""

    def __init__(self) -> None:
        self.lines = 0
        self._ours: dict[CodeType, bool] = {}

    def of(self, robot: Robot, command: str) -> int:
        self.lines = 0
        sys.settrace(self._call)
        try:
            robot.do(command)
        finally:
            sys.settrace(None)
        return self.lines

    def _call(self, frame: FrameType, _: str, __: Any) -> Any:
        code = frame.f_code
        if code not in self._ours:
            self._ours[code] = code.co_filename.startswith(CENTRAL_FOLDER)
        return self._line if self._ours[code] else None

    def _line(self, _: FrameType, event: str, __: Any) -> Any:
        self.lines += event == "line"
        return self._line


def cost(world: str, size: int) -> dict[str, int]:
    """Return the steps of each round: the median of three runs, so that one-time work does not
    count.
    """
    robot, steps, (once, each) = Robot(), Steps(), WORLDS[world]
    robot.do(once)
    for _ in range(size):
        robot.do(each)
        if world == "deep":
            robot.at = robot.newest
    return {
        name: sorted(sum(steps.of(robot, command) for command in commands) for _ in range(3))[1]
        for name, commands in ROUNDS.items()
    }


@IN_PYTHON
@pytest.mark.parametrize("world", WORLDS)
def test_request_cost_does_not_grow_with_the_tree(world: str) -> None:
    few, many = cost(world, FEW), cost(world, MANY)
    rounds = [name for name in ROUNDS if world != "deep" or "a failure" not in name]
    grown = {name: (few[name], many[name]) for name in rounds if many[name] > few[name] + LEEWAY}
    assert not grown
    assert min(few.values()) > 10
