"""Microseconds per event of the pure core for growing trees, and bytes per live task.

    python -m dev.benchmarks.core_events [--sizes 1000,100000,1000000]

Each tree is grown to its size. Then goals are sent, handled and achieved at that size. If the cost
per event is constant, the last column does not rise with the size.
"""

import gc
import statistics
import time
import tracemalloc
from typing import Any

from dev.benchmarks import options_of
from tca_central.core import Central
from tca_central.events import ConnectionId, RequestReceived
from tca_wire.constraints import Flags
from tca_wire.packets import headers
from tca_wire.packets.headers import PROTOCOL_VERSION
from tca_wire.packets.parts import HandlerFormat, MessageFormat
from tca_wire.points import TaskId
from tca_wire.vocabulary import MessageClass

PLANNER, SLOT, USER = ConnectionId(b"planner"), ConnectionId(b"slot"), ConnectionId(b"user")
BODY = b"\x07"


class Bench:
    """A planner with one slot and a user, against the core alone."""

    def __init__(self) -> None:
        self.central = Central()
        self.number = 0
        self.clock = 0.0
        walk = MessageFormat("walk", MessageClass.GOAL, "{}", "")
        for connection, index, resource in ((PLANNER, 0, ""), (SLOT, 1, "planner")):
            self.event(
                connection,
                headers.Hello(self.next(), PROTOCOL_VERSION, "planner", "p", index, resource),
            )
        self.event(USER, headers.Hello(self.next(), PROTOCOL_VERSION, "user", "u"))
        self.event(
            PLANNER, headers.Register(self.next(), [walk], [HandlerFormat("walk", "planner")])
        )
        self.top = self.goal(0)

    def next(self) -> int:
        self.number += 1
        return self.number

    def event(self, connection: ConnectionId, header: Any) -> None:
        self.clock += 1e-6
        self.central.handle(RequestReceived(self.clock, connection, header, BODY))

    def goal(self, parent: int, flags: Flags = Flags.SEQ_ACH) -> int:
        self.event(USER, headers.Send(self.next(), "walk", TaskId(parent), flags=flags))
        return self.central.tree.newest

    def newest_delivery(self) -> int:
        """Return the delivery that a handler got last."""
        return next(reversed(self.central.dispatcher.running))

    def grow(self, size: int, *, deep: bool) -> int:
        parent = self.top
        for _ in range(size):
            task = self.goal(parent)
            parent = task if deep else self.top
        return parent

    def steady(self, parent: int, rounds: int) -> list[float]:
        """Return the seconds per event.

        Each round sends a goal under *parent*, and lets the handler of an older goal return.
        """
        costs = []
        for _ in range(rounds):
            begin = time.perf_counter()
            self.goal(parent, Flags.NONE)
            self.event(SLOT, headers.Reply(self.newest_delivery()))
            costs.append((time.perf_counter() - begin) / 2)
        return costs


def main() -> None:
    parser = options_of(__doc__)
    parser.add_argument("--sizes", default="1000,100000,1000000")
    arguments = parser.parse_args()
    titles = ("tree", "tasks", "growing us/event", "bytes/task", "steady us/event: median", "p99")
    print("{:>6} {:>9} {:>17} {:>11} {:>24} {:>7}".format(*titles))
    for deep in (False, True):
        for size in map(int, arguments.sizes.split(",")):
            bench = Bench()
            begin = time.perf_counter()
            parent = bench.grow(size, deep=deep)
            growing = (time.perf_counter() - begin) / size * 1e6
            gc.collect()
            gc.freeze()
            costs = sorted(cost * 1e6 for cost in bench.steady(parent, 5000))
            gc.unfreeze()
            memory = _bytes_per_task(min(size, 20_000), deep=deep)
            shape = "deep" if deep else "wide"
            median, p99 = statistics.median(costs), costs[len(costs) * 99 // 100]
            print(
                f"{shape:>6} {size:>9,} {growing:>17.1f} {memory:>11,.0f}"
                f" {median:>24.1f} {p99:>7.1f}",
                flush=True,
            )


def _bytes_per_task(size: int, *, deep: bool) -> float:
    bench = Bench()
    tracemalloc.start()
    bench.grow(size, deep=deep)
    grown = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    return grown / size


if __name__ == "__main__":
    main()
