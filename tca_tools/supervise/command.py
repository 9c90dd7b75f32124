"""``tca run``: the command line."""

import os
import sys
from pathlib import Path

import click

from tca_tools.supervise.output import Output
from tca_tools.supervise.robot import Running
from tca_tools.supervise.robot_file import RUN, RobotFile, load
from tca_tools.supervise.supervised import GaveUp
from tca_wire.text.printable import printable

_PATIENCE = 2.0  # seconds for a screen that is slow, at the end
_NOBODY_READS = 141


@click.command()
@click.argument("file", type=click.Path(path_type=Path), default="robot.toml")
@click.option(
    "--only",
    metavar="NAMES",
    help="Only these programs, separated by commas; 'central' is one of them.",
)
@click.option("--check", is_flag=True, help="Check the file, show what it would start, and end.")
@click.pass_context
def run(context: click.Context, file: Path, only: str | None, *, check: bool) -> None:
    """Run central and a robot's programs, and keep them running.

    FILE names the programs [default: robot.toml].

    What crashes is started again, later and later; what crashes too often ends all. Ctrl-C or
    SIGTERM ends the modules, then central; a second one kills what is slow.

    The exit code is 0 after Ctrl-C or SIGTERM, or when all modules have ended well; 1 when one of
    them, ended for good, did not, or when a program crashed too often; 2 when the file is wrong.
    """
    robot = load(file)
    if only is not None:
        robot = robot.only([name.strip() for name in only.split(",")])
    if check:
        _show(robot)
        return
    names = [RUN, *(program.name for program in robot.programs)]
    in_colour = sys.stdout.isatty() and "NO_COLOR" not in os.environ
    output = Output(names, sys.stdout.fileno(), in_colour=in_colour)
    output.start()
    try:
        went_well = Running(robot, output).run()
    except GaveUp as error:
        for line in [b"its last lines:", *error.last] if error.last else [b"it said nothing"]:
            output.put(error.name, line)
        output.close(_PATIENCE)
        raise click.ClickException(f"gave up: {error}") from None
    output.close(_PATIENCE)
    context.exit(_NOBODY_READS if output.is_closed else int(not went_well))


def _show(robot: RobotFile) -> None:
    width = max(len(program.name) for program in robot.programs)
    click.echo(f"central at {robot.address}")
    for program in robot.programs:
        words = " ".join(program.command)
        click.echo(
            f"{program.name:{width}}  {printable(words)}  (in {program.cwd}, restart {program.restart})"
        )
