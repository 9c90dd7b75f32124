"""Messages of a robot on which the tests try commands of the command line, and a function that runs
such commands.
"""

from dataclasses import dataclass

import click
from click.testing import CliRunner

from tca_module import (
    Broadcast,
    Command,
    ExceptionHandler,
    Failure,
    Goal,
    Inform,
    MultiQuery,
    PollingMonitor,
    Query,
    Variable,
)

SOON = 20.0


@dataclass
class Pose:
    x: float
    y: float = 0.0


@dataclass
class Move:
    leg: int
    to: Pose


WALK, MOVE, LATER = Goal("walk", int), Command("move", Move, result=Pose), Command("later")
SAY, TICK = Inform("say", str), Broadcast("tick")
WHERE, HEALTH, SILENT = (
    Query("where", Pose, reply=Pose),
    MultiQuery("health", reply=float),
    Query("silent", reply=int),
)
MODE, POSE = Variable("mode", str), Variable("pose", Pose)
SAY_MOVE = Inform("say move", Move)
FIX, LOOK = (
    ExceptionHandler("fix"),
    PollingMonitor("look", condition=Query("is it", reply=bool), action=LATER),
)
FELL = Failure("fell", int)


def tca(command: click.Command, *words: str, given: str = "") -> tuple[int, str, str]:
    """Run a command. Return its exit code, output and errors."""
    result = CliRunner().invoke(command, words, input=given)
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return (
        result.exit_code,
        result.stdout,
        result.stderr.removeprefix("Usage:").rpartition("Error: ")[2],
    )
