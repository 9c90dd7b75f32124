"""The costs of the kinds of handlers for the same query.

    python -m dev.benchmarks.handlers [--rounds 3] [--seconds 1.0]

There are four handlers. One is plain, one a coroutine, one has a timer in its thread, and one
replies later from another thread. Central has no journal; three processes use Unix sockets, with
one query at a time. Only the ratios are comparable between machines.
"""

import queue
import statistics
import tempfile
import threading
import time
from contextlib import closing
from pathlib import Path

from dev.benchmarks import central, options_of
from dev.benchmarks.messages.processes import Children
from tca_module import Client, LaterReply, Module, Query, Task, connect

BODY = bytes(100)
KINDS = ("plain", "beside a timer", "async", "later")
QUESTIONS = {kind: Query(kind, bytes, reply=bytes) for kind in KINDS}


def serve(address: str) -> None:
    module = Module("server", address)
    owed = queue.SimpleQueue[tuple[LaterReply[bytes], bytes]]()
    for kind in ("plain", "beside a timer"):
        module.handles(QUESTIONS[kind], resource=kind)(lambda _, body: body)
    module.every(3600.0, resource="beside a timer")(print)

    @module.handles(QUESTIONS["async"], resource="async")
    async def echo(_: Task, body: bytes) -> bytes:
        return body

    @module.handles(QUESTIONS["later"], resource="later")
    def echo_later(task: Task, body: bytes) -> LaterReply[bytes]:
        later = task.reply_later()
        owed.put((later, body))
        return later

    def answer() -> None:
        while True:
            later, body = owed.get()
            later.reply(body)

    threading.Thread(target=answer, daemon=True).start()
    module.run()


def round_trip(client: Client, question: Query[bytes, bytes], seconds: float) -> float:
    """Return the mean time of a query, in microseconds."""
    client.query(question, BODY)
    trips, begin = 0, time.perf_counter()
    while (passed := time.perf_counter() - begin) < seconds:
        client.query(question, BODY)
        trips += 1
    return 1e6 * passed / trips


def measure(seconds: float) -> dict[str, float]:
    """Return the microseconds of a round trip, by kind."""
    with (
        tempfile.TemporaryDirectory() as name,
        central(Path(name), "--no-journal") as address,
        closing(Children()) as children,
    ):
        children.serve(serve, address)
        with connect("client", address) as client:
            return {
                kind: round_trip(client, question, seconds) for kind, question in QUESTIONS.items()
            }


def main() -> None:
    parser = options_of(__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=1.0)
    options = parser.parse_args()
    rounds = [measure(options.seconds) for _ in range(options.rounds)]
    print(f"{'median of ' + str(len(rounds)):>20} {'round trip, us':>15}")
    for kind in KINDS:
        print(f"{kind:>20} {statistics.median(result[kind] for result in rounds):>15.0f}")


if __name__ == "__main__":
    main()
