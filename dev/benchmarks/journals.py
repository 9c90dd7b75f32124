"""The cost to open, measure and export a journal, by size.

    python -m dev.benchmarks.journals [--sizes 100000,300000,1000000] [--ways read,fold,view]

Goals are sent, handled and achieved on the pure core, ten a step. A process for each way then
reads, folds, lays out (view), measures (stats) or exports the journal. The table has seconds and
megabytes for each million facts: if the cost is linear, its columns do not rise with the size.
"""

import argparse
import gc
import resource
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

from dev.benchmarks import measured_apart, options_of
from dev.benchmarks.core_events import BODY, SLOT, USER, Bench
from tca_central.events import ConnectionId, Record, RequestReceived
from tca_tools.export.__main__ import FORMATS
from tca_tools.journal.fold import folded
from tca_tools.journal.journals import open_log
from tca_tools.stats.measure import measure as measured
from tca_tools.view.feed import Feed
from tca_wire.journal.facts import JOURNAL_VERSION, Entry, Opened
from tca_wire.journal.records import record
from tca_wire.packets import headers


class Writer(Bench):
    """The bench, with a journal."""

    def __init__(self, stream: BinaryIO) -> None:
        self.stream = stream
        self.facts = 1
        stream.write(
            record(Entry(0, 0.0, [Opened(JOURNAL_VERSION, "bench", 1, 1_700_000_000.0, "0")]))
        )
        super().__init__()

    def event(self, connection: ConnectionId, header: Any) -> None:
        self.clock += 1e-3
        for effect in self.central.handle(RequestReceived(self.clock, connection, header, BODY)):
            if isinstance(effect, Record):
                self.stream.write(record(effect.entry))
                self.facts += len(effect.entry.facts)

    def step(self) -> None:
        """Send and handle a goal with nine subgoals."""
        self.event(USER, headers.Send(self.next(), "walk"))
        step = self.central.tree.newest
        for _ in range(9):
            self.goal(step)
        while self.central.dispatcher.running:
            self.event(SLOT, headers.Reply(self.newest_delivery()))


def read(path: Path) -> None:
    for _ in open_log(path):
        pass


def lay_out(path: Path) -> None:
    gc.disable()  # as the viewer does while it reads
    feed = Feed()
    for entry in open_log(path):
        feed.apply(entry)
    feed.columns.frame({}, {})


def export(name: str, path: Path) -> None:
    with tempfile.TemporaryDirectory() as folder:
        FORMATS[name].write(open_log(path), Path(folder) / name)


WAYS: dict[str, Callable[[Path], object]] = {
    "read": read,
    "fold": lambda path: folded(open_log(path)),
    "view": lay_out,
    "stats": lambda path: measured(folded(open_log(path))),
    **{name: partial(export, name) for name in FORMATS},
}


def measure(way: str, path: Path) -> tuple[float, float]:
    """Return seconds, and megabytes beyond those of an idle program."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    begin = time.perf_counter()
    WAYS[way](path)
    took = time.perf_counter() - begin
    return took, (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024


def main() -> None:
    parser = options_of(__doc__)
    parser.add_argument("--sizes", default="100000,300000,1000000")
    parser.add_argument("--ways", default="read,fold,view", help=f"some of {', '.join(WAYS)}")
    parser.add_argument("--measure", nargs=2, metavar=("WAY", "LOG"), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.measure:
        print(*measure(arguments.measure[0], Path(arguments.measure[1])))
        return
    ways = arguments.ways.split(",")
    print(
        f"{'facts':>10} {'MB on disk':>11} "
        + " ".join(f"{f'{way} s/M':>12} {'MB/M':>6}" for way in ways)
    )
    with tempfile.TemporaryDirectory() as folder:
        for size in map(int, arguments.sizes.split(",")):
            path = Path(folder) / f"{size}.tcaj"
            with path.open("wb") as stream:
                writer = Writer(stream)
                while writer.facts < size:
                    writer.step()
            print(f"{writer.facts:>10,} {path.stat().st_size / 1e6:>11.1f} ", end="")
            for way in ways:
                figures = measured_apart("dev.benchmarks.journals", way, path)
                seconds, megabytes = (figure / writer.facts * 1e6 for figure in figures)
                print(f"{seconds:>12.2f} {megabytes:>6.0f} ", end="", flush=True)
            print()


if __name__ == "__main__":
    main()
