"""What an event costs does not grow with the tree: whatever can be asked takes as many steps deep
down, under a very wide task and beside many monitors, taps, waits and kept tasks as where there are
few. Steps are lines of central's code.

What one call of C looks through is one step here. What looks at every task by its nature is not
here: the kill, suspension and retry of what has many under it. A failure looks for exception
handlers up to the root (decision 112).
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

HERE = str(Path(tca_central.__file__).parent)
FEW, MANY = 15, 200
LEEWAY = 120
"""Steps more that are no growth: of sweeps that come after so many events, and of a heap's
logarithm.
"""

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
        self.at = 0  #: under which task things are done
        self.do(START)
        self.at = 1

    @property
    def newest(self) -> int:
        return next(reversed(self.player.central.tree.tasks), 0)

    def do(self, text: str) -> None:
        for line in filter(None, map(str.strip, text.splitlines())):
            said = self.play(
                line.format(at=self.at, new=self.newest, number=self.player.central.tree.newest)
            )
            assert not re.search("refused|ignored", said), f"{line}: {said}"


WORLDS: dict[str, tuple[str, str]] = {
    "deep": (
        "",
        "planner: goal walk under {at} from outside\nplanner/1: reply",
    ),  # and what follows is under that
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
"""What is done once, and what many times."""

ROUNDS = {
    title: commands
    for title, *commands in map(
        str.splitlines, Path(__file__).with_name("rounds.txt").read_text().split("\n\n")
    )
}


class Steps:
    """Counts the lines of central that run."""

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
            self._ours[code] = code.co_filename.startswith(HERE)
        return self._line if self._ours[code] else None

    def _line(self, _: FrameType, event: str, __: Any) -> Any:
        self.lines += event == "line"
        return self._line


def cost(world: str, size: int) -> dict[str, int]:
    """The steps of each round; the second of three times, so that what is made once counts
    little.
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
