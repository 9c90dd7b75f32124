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
from functools import partial
from pathlib import Path

from dev.benchmarks import BODY, central, process, rate, rounds_of
from tca_module import Client, LaterReply, Module, Query, Task, connect

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


def ask(client: Client, question: Query[bytes, bytes]) -> int:
    client.query(question, BODY)
    return 1


def measure(seconds: float) -> dict[str, float]:
    """Return the microseconds of a round trip, by kind."""
    results = {}
    with tempfile.TemporaryDirectory() as name:  # noqa: SIM117
        with (
            central(Path(name), "--no-journal") as address,
            process(serve, address),
            connect("client", address) as client,
        ):
            for kind, question in QUESTIONS.items():
                client.query(question, BODY)
                results[kind] = 1e6 / rate(seconds, partial(ask, client, question))
    return results


def main() -> None:
    rounds = rounds_of(measure, __doc__ or "")
    print(f"{'median of ' + str(len(rounds)):>20} {'round trip, us':>15}")
    for kind in KINDS:
        print(f"{kind:>20} {statistics.median(result[kind] for result in rounds):>15.0f}")


if __name__ == "__main__":
    main()
