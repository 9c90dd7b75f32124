"""What an event costs does not grow with the tree: whatever can be asked takes as many steps deep down, under a very wide
task and beside many monitors, taps, waits and kept tasks as where there are few. Steps are lines of central's code.

What one call of C looks through is one step here. What looks at every task by its nature is not here: the kill,
suspension and retry of what has many under it.
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
"""Steps more that are no growth: of sweeps that come after so many events, and of a heap's logarithm."""

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
            said = self.play(line.format(at=self.at, new=self.newest, number=self.player.central.tree.newest))
            assert not re.search("refused|ignored", said), f"{line}: {said}"


WORLDS: dict[str, tuple[str, str]] = {
    "deep": ("", "planner: goal walk under {at} from outside\nplanner/1: reply"),  # and what follows is under that
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
    "sent and killed": ["user: command move under {at} from outside", "user: kill {new}"],
    "sent without a place, and killed": ["user: command move under {at} from outside flags NONE", "user: kill {new}"],
    "sent to the top, and killed": ["user: command move", "user: kill {new}"],
    "a goal with a step": [
        "user: goal walk under {at} from outside",
        "user: command move under {new} from outside",
        "user: kill {new}",
        "user: kill {new}",
    ],
    "watched until the end of a task": [
        "user: command move under {at} from outside",
        "user: polling monitor watch under {at} every 1000000 until end achieving {new} from outside",
        "user: end monitor {new}",
        "user: kill {new}",
    ],
    "watched by a handler that is above": [
        "user: command move under {at} from outside",
        "planner/1: polling monitor watch under {new} every 1000000 waited for here",
        "user: end monitor {new}",
        "user: kill {new}",
    ],
    "watched by the way": [
        "user: polling monitor watch under {at} every 1000000 waited for from outside",
        "user: end monitor {new}",
    ],
    "suspended": [
        "user: command move under {at} from outside",
        "user: suspend {new}",
        "user: resume {new}",
        "user: kill {new}",
    ],
    "a deadline": [
        "user: command move under {at} from outside",
        "user: deadline 99 for end achieving {new}",
        "user: kill {new}",
    ],
    "constrained": [
        "user: command move under {at} from outside",
        "user: constrain end achieving {new} <= end achieving {at}",
        "user: kill {new}",
    ],
    "attached": ["user: attach slipped->help to {at}", "user: remove {number}"],
    "attached to the message": ["user: attach slipped->help to walk", "user: remove {number}"],
    "tapped": ["user: tap when achieved of {at} with check", "user: remove {number}"],
    "a failure that is handled where it is": [
        "user: command move under {at} from outside handlers slipped->help",
        "user: raise slipped on {new}",
        "helper/1: resolve",
        "helper/1: reply",
        "user: kill {new}",
    ],
    "a failure that is handled far above": [
        "user: attach slipped->help to 1",
        "user: command move under {at} from outside",
        "user: raise slipped on {new}",
        "helper/1: resolve",
        "helper/1: reply",
        "user: kill {new}",
    ],
    "on termination": [
        "user: command move under {at} from outside",
        "user: command halt under {new} when killed",
        "user: kill {new}",
    ],
    "kept": ["user: keep {at}", "user: release {at}"],
    "asked about": ["user: inspect parent of {at}"],
    "asked": ["user: query where", "user: give up"],
    "told": ["user: inform note", "user: set mode 7"],
    "locked": ["user: lock helper", "user: release"],
    "waited for": ["user: wait end achieving {at}", "user: give up"],
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
    """The steps of each round; the second of three times, so that what is made once counts little."""
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
def test_nothing_that_is_asked_takes_more_steps_in_a_larger_tree(world: str) -> None:
    few, many = cost(world, FEW), cost(world, MANY)
    grown = {name: (few[name], many[name]) for name in ROUNDS if many[name] > few[name] + LEEWAY}
    assert not grown
    assert min(few.values()) > 10
