"""How the shows of robots are run, and how they save pictures."""

import argparse
import logging
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from click import ClickException, Command

from tca_module import TcaError
from tca_tools.drawing.pictures import convert_svg
from tca_tools.errors import NoPicture
from tca_tools.gantt.__main__ import gantt
from tca_tools.tasktree_viz.__main__ import tree


def run_show(parser: argparse.ArgumentParser, show: Callable[[argparse.Namespace], int]) -> int:
    """Run the show with the options of the command line. Returns the exit code."""
    options = parser.parse_args()
    logging.basicConfig(level=logging.WARNING, format="%(name)s: %(message)s")
    # SIGTERM works like Ctrl-C, so the programs are stopped in order.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        return show(options)
    except OSError as error:
        parser.error(f"--out: {error}")
    except TcaError as error:
        print(f"ended: {error}; the files so far are in {options.out}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print(f"ended by Ctrl-C; the files so far are in {options.out}", file=sys.stderr)
        return 130


def draw_history(folder: Path, warn: Callable[[str], object] = print) -> Iterator[Path]:
    """Draw the task tree and the Gantt chart of the run. Yields each file written.

    *warn* is called with the error of a failed drawing.
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
    """Write the picture as .svg and, where possible, as .png. Returns the files written."""
    written = [path.with_suffix(".svg")]
    written[0].write_text(svg)
    try:
        png = convert_svg(svg, "png")
    except NoPicture as error:
        print(error, file=sys.stderr)
        return written
    written.append(path.with_suffix(".png"))
    written[1].write_bytes(png)
    return written
