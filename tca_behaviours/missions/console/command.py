"""The command ``tca console``."""

from collections.abc import Callable
from pathlib import Path

import click

from tca_behaviours.missions.client.mission import Mission
from tca_behaviours.missions.client.stub import MADE_BY, stub_text
from tca_behaviours.missions.console.names import ConsoleNames
from tca_module import MisuseError, TcaError
from tca_wire.endpoint import VARIABLE
from tca_wire.text.missing import missing_package
from tca_wire.text.printable import printable

_PATIENCE = 2.0  # seconds that a person waits for the server


@click.command()
@click.argument("server", required=False, default="")
@click.option("--central", metavar="ADDRESS", help=f"Where central listens [default: ${VARIABLE}].")
@click.option(
    "--stub", metavar="FILE", type=click.Path(path_type=Path, dir_okay=False),
    help="Write a Python file that tells editors and type checkers of the tasks, and end.",
)  # fmt: skip
def console(server: str, central: str | None, stub: Path | None) -> None:
    """Run tasks of a server by typing them: all tasks are functions.

    index() lists the tasks, status() what runs, help(TASK) explains one. Ctrl-C stops the task that is waited for,
    Ctrl-D leaves; what still runs in the background is stopped then.
    """
    try:
        run_shell = _shell() if stub is None else None
        with Mission(server, name="console", central=central, patience=_PATIENCE) as mission:
            if stub is not None:
                _write(stub, stub_text(mission.server, mission.offered().values()))
            elif run_shell is not None:
                run_shell(ConsoleNames(mission))
    except MisuseError as error:
        raise click.UsageError(printable(str(error))) from None
    except TcaError as error:
        raise click.ClickException(printable(str(error))) from None


def _shell() -> Callable[[ConsoleNames], None]:
    """What reads and runs the lines; IPython is an extra."""
    try:
        from tca_behaviours.missions.console.shell import run_shell  # noqa: PLC0415
    except ImportError:
        raise click.ClickException(missing_package("tca console", "ipython", "console")) from None
    return run_shell


def _write(file: Path, text: str) -> None:
    try:
        if file.exists() and MADE_BY not in file.read_text(errors="replace"):
            raise click.UsageError(f"{file} was not made by --stub: remove it, or give another name")
        unfinished = file.with_name(f"{file.name}.part")
        unfinished.write_text(text)
        unfinished.replace(file)
    except OSError as error:
        raise click.ClickException(f"{file}: can't be written: {error.strerror}: give another name") from None
    click.echo(f"wrote {file}")
