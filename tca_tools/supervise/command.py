"""``tca run``: the command line."""

import os
import sys
from pathlib import Path

import click

from tca_tools.errors import ToolError
from tca_tools.supervise.control import ask
from tca_tools.supervise.output import Output
from tca_tools.supervise.robot import Running
from tca_tools.supervise.robot_file import RUN, RobotFile, load
from tca_tools.supervise.supervised import GaveUp
from tca_wire.log_address import without_secrets
from tca_wire.text.printable import printable

_PATIENCE = 2.0
"""Seconds to print the remaining output at the end."""
_BROKEN_PIPE = 141
"""The exit code when the reader of the output has ended, as after SIGPIPE."""


@click.command()
@click.argument("file", type=click.Path(path_type=Path), default="robot.toml")
@click.option(
    "--only",
    metavar="NAMES",
    help="Only these programs, separated by commas; 'central' is one of them.",
)
@click.option("--stop", metavar="NAMES", help="Have the running 'tca run' stop these programs.")
@click.option("--start", metavar="NAMES", help="Have it start them again.")
@click.option("--restart", metavar="NAMES", help="Have it stop and start them.")
@click.option("--check", is_flag=True, help="Check the file, show what it would start, and end.")
@click.pass_context
def run(
    context: click.Context,
    file: Path,
    only: str | None,
    stop: str | None,
    start: str | None,
    restart: str | None,
    *,
    check: bool,
) -> None:
    """Run central and a robot's programs, and keep them running.

    FILE names the programs [default: robot.toml].

    A program that crashes is started again, after a growing delay. A program that crashes too often
    ends all. Ctrl-C or SIGTERM ends the modules, then central; a second one kills slow programs.

    --stop, --start and --restart act on programs of a FILE that runs. Central then keeps its run.

    The exit code is 0 after Ctrl-C or SIGTERM, or when all modules have ended with exit code 0. It
    is 1 when a module ended otherwise for good, or a program crashed too often. It is 2 when the
    file is wrong.
    """
    asked = {"stop": stop, "start": start, "restart": restart}
    if chosen := {action: names for action, names in asked.items() if names is not None}:
        if len(chosen) > 1 or only is not None or check:
            raise click.UsageError("give one of --stop, --start and --restart, and no other option")
        ((action, given),) = chosen.items()
        click.echo("\n".join(ask(file, action, _listed(given))))
        return
    robot = load(file)
    if only is not None:
        robot = robot.only(_listed(only))
    if check:
        _show(robot)
        return
    names = [RUN, *(program.name for program in robot.programs)]
    in_colour = sys.stdout.isatty() and "NO_COLOR" not in os.environ
    try:
        for folder in robot.folders:
            folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ToolError(f"log: {error.filename} can't be made: {error.strerror}") from None
    output = Output(names, sys.stdout.fileno(), in_colour=in_colour, logs=robot.logs)
    output.start()
    try:
        went_well = Running(robot, output, file).run()
    except GaveUp as error:
        for line in [b"its last lines:", *error.last] if error.last else [b"it printed nothing"]:
            output.show(error.name, line)
        output.close(_PATIENCE)
        raise click.ClickException(f"gave up: {error}") from None
    output.close(_PATIENCE)
    context.exit(_BROKEN_PIPE if output.is_closed else int(not went_well))


def _listed(names: str) -> list[str]:
    return [name.strip() for name in names.split(",")]


def _show(robot: RobotFile) -> None:
    width = max(len(program.name) for program in robot.programs)
    click.echo(f"central at {robot.address}")
    for program in robot.programs:
        words = " ".join(without_secrets(one) if "://" in one else one for one in program.command)
        click.echo(
            f"{program.name:{width}}  {printable(words)}"
            f"  (in {program.cwd}, restart {program.restart})"
        )
