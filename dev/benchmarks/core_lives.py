"""Processor time of the pure core for the life of one message: sent, delivered, answered.

    python -m dev.benchmarks.core_lives

It shows the best and the median of several runs, each of many lives in a row, in microseconds. In a
"sequence", ten commands are under way, each after the previous one. The handler of "asked" decides
about requests of clients. An observer gets three changes of state of each task "observed".
"""

import gc
import statistics
import time
from collections.abc import Iterator
from typing import Any

from tca_central.core import Central
from tca_central.events import ConnectionId, RequestReceived
from tca_central.loading import is_compiled
from tca_wire.packets import headers
from tca_wire.packets.changes import Observe
from tca_wire.packets.parts import HandlerFormat, MessageFormat
from tca_wire.vocabulary import MessageClass

MODULE, SLOT, USER = ConnectionId(b"module"), ConnectionId(b"slot"), ConnectionId(b"user")
LIVES, RUNS = 300, 15
KINDS = {
    "command": ("command", 1),
    "asked": ("asked", 1),
    "observed": ("observed", 1),
    "sequence": ("command", 10),
    "query": ("query", 1),
    "inform": ("inform", 1),
}
"""By name: the class of message, and the number under way."""


def central() -> Central:
    made = Central()
    messages = [
        MessageFormat(name, MessageClass(name), "{}", "") for name in ("command", "query", "inform")
    ]
    messages += [
        MessageFormat(name, MessageClass.COMMAND, "{}", "") for name in ("asked", "observed")
    ]
    handlers = [
        HandlerFormat(one.name, "r", takes=["update"] * (one.name == "asked")) for one in messages
    ]
    for connection, module, place, resource in (
        (MODULE, "m", 0, ""),
        (SLOT, "m", 1, "r"),
        (USER, "u", 0, ""),
    ):
        hello = headers.Hello(1, headers.PROTOCOL_VERSION, module, module, place, resource)
        made.handle(RequestReceived(0.0, connection, hello))
    made.handle(RequestReceived(0.0, MODULE, headers.Register(2, messages, handlers)))
    made.handle(RequestReceived(0.0, MODULE, Observe(3, message="observed")))
    return made


def events(name: str, under_way: int, first: int) -> Iterator[Any]:
    """Yield the events of all lives; *first* is the id of the first message."""
    for life in range(LIVES):
        number = 0 if name == "inform" else 2 + life
        yield RequestReceived(2.0, USER, headers.Send(number, name), b"\x07")
        if life + 1 >= under_way:
            yield RequestReceived(2.0, SLOT, headers.Reply(first + life + 1 - under_way), b"\x07")


def cost(name: str, under_way: int) -> float:
    """Return the microseconds of one life."""
    core = central()
    prepared = list(events(name, under_way, core.tree.newest + 1))
    gc.collect()
    gc.disable()
    begin = time.thread_time_ns()
    for event in prepared:
        core.handle(event)
    end = time.thread_time_ns()
    gc.enable()
    return (end - begin) / LIVES / 1000


def main() -> None:
    print(f"{'compiled' if is_compiled() else 'Python':>10}   us: best  median")
    for kind, (name, under_way) in KINDS.items():
        costs = [cost(name, under_way) for _ in range(RUNS)]
        print(f"{kind:>10} {min(costs):>10.1f} {statistics.median(costs):>7.1f}")


if __name__ == "__main__":
    main()
