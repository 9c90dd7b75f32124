"""The command ``tca console``."""

from pathlib import Path

import click

from tca_behaviours.missions.client.mission import Mission
from tca_behaviours.missions.client.stub import MADE_BY, stub_text
from tca_behaviours.missions.console.names import ConsoleNames
from tca_tools.errors import extra
from tca_tools.live.shared import as_usage, central_option
from tca_tools.output import write_output, writing

_PATIENCE = 2.0  # seconds to wait for the server: the user waits at the prompt


@click.command()
@click.argument("server", required=False, default="")
@central_option
@click.option(
    "--stub",
    metavar="FILE",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write a Python file that describes the tasks to editors and type checkers, and exit.",
)
def console(server: str, central: str | None, stub: Path | None) -> None:
    """Run tasks of a server by typing them: each task is a function.

    index() lists the tasks, status() the running ones, help(TASK) explains one. Ctrl-C stops the
    task that you wait for. Ctrl-D leaves, and stops all tasks that still run.
    """
    with as_usage():
        mission = Mission(server, name="console", central=central, patience=_PATIENCE)
        if stub is not None:
            with mission:
                _write(stub, stub_text(mission.server, mission.offered().values()))
            return
        with extra("console", "tca console", package="ipython"):
            # IPython is an extra, so this import comes late.
            from tca_behaviours.missions.console.shell import run_shell  # noqa: PLC0415
        with mission:
            run_shell(ConsoleNames(mission))


def _write(file: Path, text: str) -> None:
    with writing(file):
        if file.exists() and MADE_BY not in file.read_text(errors="replace"):
            raise click.UsageError(
                f"{file} was not made by --stub: remove it, or give another name"
            )
    write_output(file, text)
    click.echo(f"wrote {file}")
