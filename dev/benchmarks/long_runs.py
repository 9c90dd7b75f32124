"""The cost of each tool for long runs: seconds and megabytes for four journals, at n/10 and at n.

    python -m dev.benchmarks.long_runs [--shapes retries,children,levels,waits] [--tools
    tree,report] [--share 0.1]

The journals come from the pure core: 10,000 retries of one command, 10,000 children of one task,
10,000 levels, and 100,000 waits for one resource, or a share of these numbers. Each tool reads each
journal in a process of its own. The ratio compares the seconds for each entry: about 1 if the cost
is linear. The figures leave out the cost of an empty run.
"""

import argparse
import asyncio
import contextlib
import io
import math
import resource
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

from dev.benchmarks import measured_apart, options_of
from dev.benchmarks.core_events import PLANNER, SLOT, USER
from dev.benchmarks.journals import Writer
from tca_central.events import ConnectionId
from tca_tools.command_line import main as tca
from tca_tools.errors import ToolError
from tca_tools.journal.journals import open_log
from tca_tools.replay.app import Replay
from tca_tools.replay.recording import Recording
from tca_tools.view import answers
from tca_tools.view.reading import Reading
from tca_wire.constraints import Flags
from tca_wire.packets import headers
from tca_wire.packets.parts import Attachment, HandlerFormat, MessageFormat
from tca_wire.points import TaskId
from tca_wire.vocabulary import MessageClass

_ENDLESS = 1_000_000_000
_CLICKS = 10


class LongRun(Writer):
    """A walk of one planner, whose journal grows to any length."""

    def __init__(self, stream: BinaryIO) -> None:
        super().__init__(stream)
        self.event(SLOT, headers.Reply(self.newest_delivery()))

    def retries(self, count: int) -> None:
        """Let one task fail again and again; an exception handler retries it."""
        expert = ConnectionId(b"expert")
        rescue = MessageFormat("rescue", MessageClass.EXCEPTION, "{}", "")
        self.event(
            expert, headers.Hello(self.next(), headers.PROTOCOL_VERSION, "expert", "e", 1, "expert")
        )
        self.event(PLANNER, headers.Register(self.next(), [rescue], []))
        self.event(
            expert, headers.Register(self.next(), [rescue], [HandlerFormat("rescue", "expert")])
        )
        self.event(USER, headers.Attach(self.next(), Attachment("", "rescue", _ENDLESS)))
        task = TaskId(self.goal(0))
        for _ in range(count):
            self.event(SLOT, headers.Fail(self.newest_delivery(), "slip", "left foot"))
            handler = self.newest_delivery()
            self.event(expert, headers.Retry(self.next(), task, origin=handler))
            self.event(expert, headers.Reply(handler))
        self._finish()

    def children(self, count: int) -> None:
        """Give one task many subtasks."""
        walk = self.goal(0)
        for _ in range(count):
            self.goal(walk)
        self._finish()

    def levels(self, count: int) -> None:
        """Let each handler send one subtask."""
        task = self.goal(0)
        for _ in range(count):
            delivery = self.newest_delivery()
            task = self.goal(task)
            self.event(SLOT, headers.Reply(delivery))
        self._finish()

    def waits(self, count: int) -> None:
        """Send many tasks at once; they wait for one resource."""
        for _ in range(count):
            self.goal(0, Flags.NONE)
        self._finish()

    def _finish(self) -> None:
        while self.central.dispatcher.running:
            self.event(SLOT, headers.Reply(self.newest_delivery()))


SHAPES = {"retries": 10_000, "children": 10_000, "levels": 10_000, "waits": 100_000}


def make(shape: str, count: int, path: Path) -> int:
    """Write a journal; return the number of its entries."""
    with path.open("wb") as stream:
        run = LongRun(stream)
        getattr(run, shape)(count)
    return sum(1 for _ in open_log(path))


def _command(name: str, output: str = "") -> Callable[[Path], object]:
    def run(path: Path) -> None:
        with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
            named = ["-o", str(Path(folder) / output)] if output else []
            with contextlib.suppress(ToolError):  # schedule: no coordinator
                tca([*name.split(), str(path), *named], standalone_mode=False)

    return run


def _replay(path: Path) -> None:
    """Show the screen at some places."""

    async def show() -> None:
        app = Replay(Recording(open_log(path)), "run")
        async with app.run_test(size=(120, 40)) as pilot:
            for part in range(_CLICKS):
                app.go_to(app.recording.last * part // _CLICKS)
                await pilot.pause()

    asyncio.run(show())


def _click(path: Path) -> None:
    """Load the page's data, then click on some tasks, at the end and in the middle of the run."""
    reading = Reading(open_log(path))
    for entry in open_log(path):
        reading.feed.apply(entry)
    reading.feed.columns.frame({}, {})
    run = reading.feed.history
    numbers = list(run.tasks)
    for instant in (run.time, run.time / 2):
        answers.causes_answer(reading, instant)
        for first in [1, 2, *(len(numbers) * part // _CLICKS for part in range(_CLICKS))]:
            chosen = numbers[first:][:30]
            answers.message_answer(reading, (chosen or numbers)[0], instant)
            answers.notes_answer(reading, chosen, instant)


TOOLS: dict[str, Callable[[Path], object]] = {
    "log": _command("log show"),
    "tree": _command("tree"),
    "tree --all": _command("tree --all"),
    "tree --story": _command("tree --story 1"),
    "tree svg": _command("tree", "tree.svg"),
    "gantt": _command("gantt"),
    "gantt svg": _command("gantt", "gantt.svg"),
    "report": _command("report", "report.html"),
    "replay --text": _command("replay --text"),
    "replay": _replay,
    "check": _command("check"),
    "stats": _command("stats"),
    "schedule": _command("schedule"),
    "view": _click,
    **{
        f"export {name}": _command(f"export --to {name}", name)
        for name in ("jsonl", "csv", "mcap", "perfetto")
    },
}


def measure(tool: str, path: Path) -> tuple[float, float]:
    """Return processor seconds, and the peak of this process's memory in megabytes."""
    begin = time.process_time()
    TOOLS[tool](path)
    return time.process_time() - begin, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main() -> None:
    parser = options_of(__doc__)
    parser.add_argument("--shapes", default=",".join(SHAPES))
    parser.add_argument("--tools", default=",".join(TOOLS))
    parser.add_argument("--share", type=float, default=1.0)
    parser.add_argument("--patience", type=float, default=600.0, help="Seconds.")
    parser.add_argument("--measure", nargs=2, metavar=("TOOL", "LOG"), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.measure:
        print(*measure(arguments.measure[0], Path(arguments.measure[1])))
        return
    columns = f"{'s at n/10':>10} {'at n':>7} {'ratio':>6} {'MB at n/10':>11} {'at n':>7}"
    print(f"{'journal':>9} {'n':>8} {'tool':>16} {columns}")
    with tempfile.TemporaryDirectory() as folder:
        for shape in arguments.shapes.split(","):
            most = int(SHAPES[shape] * arguments.share)
            paths = [Path(folder) / f"{shape}{count}.tcaj" for count in (1, most // 10, most)]
            entries = [
                make(shape, count, path)
                for count, path in zip((1, most // 10, most), paths, strict=True)
            ]
            for tool in arguments.tools.split(","):
                base, few, many = (_took(tool, path, arguments.patience) for path in paths)
                (few_s, few_mb), (many_s, many_mb) = (
                    [a - b for a, b in zip(one, base, strict=True)] for one in (few, many)
                )
                ratio = many_s / few_s * entries[1] / entries[2]
                figures = f"{few_s:>10.2f} {many_s:>7.2f} {ratio:>6.2f}"
                print(
                    f"{shape:>9} {most:>8,} {tool:>16} {figures} {few_mb:>11.1f} {many_mb:>7.1f}",
                    flush=True,
                )


def _took(tool: str, path: Path, patience: float) -> tuple[float, float]:
    try:
        return measured_apart("dev.benchmarks.long_runs", tool, path, patience)
    except subprocess.TimeoutExpired:
        return math.inf, math.inf


if __name__ == "__main__":
    main()
