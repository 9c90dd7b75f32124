"""What the shows of robots share: how they are run, and pictures."""

import argparse
import logging
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from click import ClickException, Command

from tca_module import TcaError
from tca_tools.drawing.pictures import converted
from tca_tools.errors import NoPicture
from tca_tools.gantt.__main__ import gantt
from tca_tools.tasktree_viz.__main__ import tree


def shown(parser: argparse.ArgumentParser, show: Callable[[argparse.Namespace], int]) -> int:
    """Run the show with the options of the command line; the exit code."""
    options = parser.parse_args()
    logging.basicConfig(level=logging.WARNING, format="%(name)s: %(message)s")
    signal.signal(
        signal.SIGTERM, signal.default_int_handler
    )  # as Ctrl-C: the programs are stopped in order
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


def history(folder: Path, warn: Callable[[str], object] = print) -> Iterator[Path]:
    """The task tree and the Gantt chart of the run. With *warn* it is said what can't be made, and
    why.
    """
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
