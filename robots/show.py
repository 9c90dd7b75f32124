"""What the shows of robots share: the command line, a central with programs, and pictures."""

import argparse
import logging
import signal
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from click import ClickException, Command

from robots.processes import Processes
from tca_module import SentTask, TcaError, Timeout
from tca_tools.drawing.pictures import converted
from tca_tools.errors import NoPicture
from tca_tools.gantt.__main__ import gantt
from tca_tools.tasktree_viz.__main__ import tree

START_TIME = 60.0
"""Seconds within which all programs must be there."""

LOOKS = 0.1
"""Seconds between two looks at whether they still are."""


def parser_of(robot: str, description: str | None) -> argparse.ArgumentParser:
    """The command line of `python -m robots.<robot>_sim`, with the option that all shows have."""
    parser = argparse.ArgumentParser(prog=f"python -m robots.{robot}_sim", description=description)
    out = Path("runs", robot)
    parser.add_argument("--out", type=Path, default=out, help="folder of its files (%(default)s)")
    return parser


def between(least: float, most: float, what: str) -> Callable[[str], float]:
    """The type of an option that is a number in these bounds."""

    def number(text: str) -> float:
        if not least <= float(text) <= most:
            raise argparse.ArgumentTypeError(f"{what} is a number from {least:g} to {most:,g}, not {text}")
        return float(text)

    return number


def shown(parser: argparse.ArgumentParser, show: Callable[[argparse.Namespace], int]) -> int:
    """Run the show with the options of the command line; the exit code."""
    options = parser.parse_args()
    logging.basicConfig(level=logging.WARNING, format="%(name)s: %(message)s")
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C: the programs are stopped in order
    try:
        return show(options)
    except OSError as error:
        parser.error(f"--out: {error}")
    except TcaError as error:
        print(f"ended: {error}; what happened so far is in {options.out}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print(f"ended by Ctrl-C; what happened so far is in {options.out}", file=sys.stderr)
        return 130


@contextmanager
def central(folder: Path, prefix: str = "", *, is_fresh: bool = True) -> Iterator[tuple[str, Processes]]:
    """Central, with a journal in the folder: its address, and the programs beside it.

    Args:
        folder: the place of the journal and of what the programs print.
        prefix: the beginning of their names there.
        is_fresh: a new run begins also where one is unfinished. False: it continues, as after central was killed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="show") as sockets:
        address = f"ipc://{sockets}/central.sock"
        with Processes(folder, {"TCA_CENTRAL": address}) as processes:
            journal = str(folder / f"{prefix}journal")
            processes.start(f"{prefix}central", "tca_central", "--journal", journal, *["--fresh"] * is_fresh)
            yield address, processes


def looks(task: SentTask[Any], processes: Processes) -> Iterator[bool]:
    """Time to look at a task, until it has ended: whether it has. Raises TcaError if a program ends before."""
    is_over = False
    while not is_over:
        try:
            task.wait(LOOKS)
            is_over = True
        except Timeout:
            if name := processes.ended():
                raise TcaError(f"{name} has ended: see {processes.log(name)}") from None
        yield is_over


def history(folder: Path, warn: Callable[[str], object] = print) -> Iterator[Path]:
    """The task tree and the Gantt chart of the run. With *warn* it is said what can't be made, and why."""
    tools: dict[str, Command] = {"tree.svg": tree, "gantt.svg": gantt}
    for name, tool in tools.items():
        try:
            tool.main([str(folder / "journal"), "-o", str(folder / name)], standalone_mode=False)
        except ClickException as error:
            warn(error.format_message())
        else:
            yield folder / name


def save_picture(path: Path, svg: str) -> list[Path]:
    """Write it as .svg and, where that is possible, as .png; the files that were made."""
    made = [path.with_suffix(".svg"), path.with_suffix(".png")]
    made[0].write_text(svg)
    try:
        made[1].write_bytes(converted(svg, "png"))
    except NoPicture as error:
        print(error, file=sys.stderr)
        del made[1]
    return made
