"""Direct messages beside the same through central: queries one at a time and many at once, informs to their end.

    python -m benchmarks.direct [--rounds 3] [--seconds 1.0]

Central keeps its journal, so both are noted there; three processes, Unix sockets, 100-byte bodies and a large one.
Ratios hold.
"""

import statistics
import tempfile
from functools import partial
from pathlib import Path

from benchmarks import rounds_of
from benchmarks.messaging import BODY, OUTSTANDING, central, process, rate
from tca_module import Client, Inform, Module, Query, Task, connect

WAYS = ("central", "direct")
ECHO = {way: Query(f"echo {way}", bytes, reply=bytes) for way in WAYS}
POSE = {way: Inform(f"pose {way}", bytes) for way in WAYS}
SEEN = {way: Query(f"seen {way}", reply=int) for way in WAYS}
LARGE = bytes(1 << 20)
INFORMS = 500


def serve(address: str) -> None:
    module = Module("server", address)
    for way in WAYS:
        add_handlers(module, way)
    module.run()


def add_handlers(module: Module, way: str) -> None:
    is_direct, seen = way == "direct", [0]
    module.handles(ECHO[way], resource=way, direct=is_direct)(lambda _, body: body)

    @module.handles(POSE[way], resource=way, direct=is_direct)
    def pose(_: Task, body: bytes) -> None:
        seen[0] += bool(body)

    @module.handles(SEEN[way], resource=way, direct=is_direct)
    def count(_: Task) -> int:
        return seen[0]


def measure(seconds: float) -> dict[str, float]:
    """By way and kind: microseconds a round trip, or messages a second."""
    results = {}
    with tempfile.TemporaryDirectory() as name:
        journal = ("--journal", str(Path(name) / "journal"))
        with central(Path(name), *journal) as address, process(serve, address), connect("client", address) as client:
            for way in WAYS:
                exchange(client, way)  # central tells of the direct way
                exchange(client, way)
                results[f"{way}: round trip, us"] = 1e6 / rate(seconds, partial(one, client, way, BODY))
                results[f"{way}: round trip of 1 MiB, us"] = 1e6 / rate(seconds, partial(one, client, way, LARGE))
                results[f"{way}: queries/s, {OUTSTANDING} open"] = rate(seconds, partial(exchange, client, way))
                results[f"{way}: informs/s"] = rate(seconds, partial(inform, client, way))
    return results


def one(client: Client, way: str, body: bytes) -> int:
    client.query(ECHO[way], body)
    return 1


def exchange(client: Client, way: str) -> int:
    pending = [client.query_send(ECHO[way], BODY) for _ in range(OUTSTANDING)]
    for reply in pending:
        reply.receive()
    return OUTSTANDING


def inform(client: Client, way: str) -> int:
    before = client.query(SEEN[way])
    for _ in range(INFORMS):
        client.inform(POSE[way], BODY)
    while client.query(SEEN[way]) - before < INFORMS:
        pass
    return INFORMS


def main() -> None:
    rounds = rounds_of(measure, __doc__ or "")
    print(f"{'median of ' + str(len(rounds)):>24} {'central':>10} {'direct':>10} {'direct / central':>17}")
    for key in [key.partition(": ")[2] for key in rounds[0] if key.startswith("central")]:
        through, direct = (statistics.median(one[f"{way}: {key}"] for one in rounds) for way in WAYS)
        print(f"{key:>24} {through:>10,.0f} {direct:>10,.0f} {direct / through:>17.2f}")


if __name__ == "__main__":
    main()
