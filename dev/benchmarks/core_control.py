"""The cost of control in a big tree: wiretaps, failures, suspension, deadlines and kills.

    python -m dev.benchmarks.core_control [--sizes 1000,100000,1000000]

A tree of tapped goals is grown under a top-level task with a deadline and a termination message. An
exception handler for any failure is at the root, up to a million levels above.

First come the costs per event, as in core_events.py. Then each operation happens once. The table
shows its time, during which central does nothing else, and that time divided by the number of
tasks. One goal is handled, all others wait for its slot.
"""

import gc
import statistics
import time
from typing import Any

from dev.benchmarks import options_of
from dev.benchmarks.core_events import SLOT, USER, Bench
from tca_central.events import ConnectionId, Tick
from tca_wire.constraints import Flags
from tca_wire.packets import headers
from tca_wire.packets.parts import Attachment, HandlerFormat, MessageFormat
from tca_wire.points import Moment, Point, TaskId
from tca_wire.vocabulary import Condition, MessageClass

EXPERT, EXPERT_SLOT = ConnectionId(b"expert"), ConnectionId(b"expert slot")
DEADLINE = 1e6
"""Seconds by the clock of the benchmark."""


class Steered(Bench):
    """The planner and user of core_events.py, and an expert."""

    def __init__(self) -> None:
        super().__init__()
        messages = [
            MessageFormat("recover", MessageClass.EXCEPTION, "{}", ""),
            MessageFormat("note", MessageClass.INFORM, "{}", ""),
            MessageFormat("halt", MessageClass.COMMAND, "{}", "{}"),
        ]
        handlers = [HandlerFormat(message.name, "expert") for message in messages]
        self.event(EXPERT, headers.Hello(self.next(), headers.PROTOCOL_VERSION, "expert", "e"))
        self.event(EXPERT, headers.Register(self.next(), messages, handlers))
        self.event(
            EXPERT_SLOT,
            headers.Hello(self.next(), headers.PROTOCOL_VERSION, "expert", "e", 1, "expert"),
        )
        self.event(USER, headers.Attach(self.next(), Attachment("", "recover")))
        self.event(USER, headers.Tap(self.next(), Condition.WHILE_HANDLING, "note", "walk"))
        self.event(USER, headers.Send(self.next(), "halt", TaskId(self.top), when_killed=True))
        at = Point(TaskId(self.top), Moment.END_ACHIEVING)
        self.event(USER, headers.Deadline(self.next(), at, DEADLINE))

    def grow(self, size: int, *, deep: bool) -> int:
        """Grow the tree; return the newest task, which is the deepest."""
        newest = self.top
        for _ in range(size):
            newest = self.goal(newest if deep else self.top, Flags.NONE)
        return newest

    def handled_by(self, slot: ConnectionId) -> int:
        """Return the message that a slot handles."""
        return next(
            one.handling_id
            for one in self.central.dispatcher.running.values()
            if one.slot and one.slot.id == slot
        )

    def steady(self, parent: int, rounds: int) -> list[float]:
        """Return the seconds per event.

        Each round sends a goal. Then two handlers return: those of an older goal and of that goal's
        wiretap.
        """
        costs = []
        for _ in range(rounds):
            begin = time.perf_counter()
            self.goal(parent, Flags.NONE)
            self.event(SLOT, headers.Reply(self.handled_by(SLOT)))
            self.event(EXPERT_SLOT, headers.Reply(self.handled_by(EXPERT_SLOT)))
            costs.append((time.perf_counter() - begin) / 3)
        return costs

    def resolve(self) -> float:
        """Resolve the failure that the expert handles; return the seconds of its reply."""
        delivery = self.handled_by(EXPERT_SLOT)
        self.event(EXPERT_SLOT, headers.Resolve(self.next(), delivery))
        return self.timed(headers.Reply(delivery), EXPERT_SLOT)

    def timed(self, header: Any, connection: ConnectionId = USER) -> float:
        """Return the seconds that a message takes."""
        begin = time.perf_counter()
        self.event(connection, header)
        return time.perf_counter() - begin

    def operations(self, bottom: int) -> dict[str, float]:
        """Return the seconds that each operation takes."""
        top, costs = TaskId(self.top), {}
        costs["failure at the bottom"] = self.timed(
            headers.Raise(self.next(), TaskId(bottom), "slip")
        )
        costs["it is handled"] = self.resolve()
        costs["suspend"] = self.timed(headers.Suspend(self.next(), top))
        costs["resume"] = self.timed(headers.Suspend(self.next(), top, resume=True))
        costs["deadline of the top"] = self._pass(DEADLINE)
        costs["that is handled"] = self.resolve()
        costs["kill"] = self.timed(headers.Kill(self.next(), top))
        costs["last handler returns"] = self.timed(headers.Reply(self.handled_by(SLOT)), SLOT)
        left = self.central.tree.tasks.values()
        assert [task.message.name for task in left if not task.killed] == ["halt"], (
            "all else has ended"
        )
        return costs

    def _pass(self, seconds: float) -> float:
        self.clock += seconds
        begin = time.perf_counter()
        self.central.handle(Tick(self.clock))
        return time.perf_counter() - begin


def measure(size: int, *, deep: bool) -> tuple[float, float, dict[str, float]]:
    """Return the microseconds per event, first while the tree grows, then at its full size, and the
    seconds of each operation.
    """
    bench = Steered()
    begin = time.perf_counter()
    bottom = bench.grow(size, deep=deep)
    growing = (time.perf_counter() - begin) / size * 1e6
    gc.collect()
    gc.freeze()
    steady = statistics.median(bench.steady(bottom, 2000)) * 1e6
    operations = bench.operations(bottom)
    gc.unfreeze()
    return growing, steady, operations


def main() -> None:
    parser = options_of(__doc__)
    parser.add_argument("--sizes", default="1000,100000,1000000")
    sizes = [int(size) for size in parser.parse_args().sizes.split(",")]
    for deep in (False, True):
        found = [measure(size, deep=deep) for size in sizes]
        print(f"{'deep' if deep else 'wide':>24}" + "".join(f"{size:>22,}" for size in sizes))
        for name, index in (("growing, us/event", 0), ("steady, us/event", 1)):
            print(f"{name:>24}" + "".join(f"{one[index]:>22.1f}" for one in found))
        for name in found[0][2]:
            costs = [one[2][name] for one in found]
            cells = (
                f"{c * 1e3:,.1f} ms {c / size * 1e6:6.2f} us"
                for c, size in zip(costs, sizes, strict=True)
            )
            print(f"{name:>24}" + "".join(f"{cell:>22}" for cell in cells), flush=True)


if __name__ == "__main__":
    main()
