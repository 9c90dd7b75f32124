"""The cost of keys and of the log of inputs: round trips and messages a second over TCP.

The variants take turns, each with a journal; the ratios are to the one without keys and inputs.

python -m dev.benchmarks.keys [rounds]
"""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from contextlib import ExitStack
from pathlib import Path

from dev.benchmarks.messages.contestant import run_open, timed
from tca_module import Client, Inform, Query, connect

PING, NOTE = Query("ping", bytes, reply=bytes), Inform("note", bytes)
SEEN = Query("seen", reply=int)
TRIPS, MANY = 300, 3000
BODY = b"x" * 100

SERVER = """
import sys
from tca_module import Inform, Module, Query
module, count = Module("server", sys.argv[1]), [0]
module.handles(Query("ping", bytes, reply=bytes))(lambda _, body: body)
@module.handles(Inform("note", bytes))
def note(_, body): count[0] += 1
module.handles(Query("seen", reply=int))(lambda _: count[0])
module.run()
"""


def start(stack: ExitStack, *options: str) -> Client:
    command = [sys.executable, "-m", "tca_central", "--bind", "tcp://127.0.0.1:*", *options]
    central = stack.enter_context(subprocess.Popen(command, stderr=subprocess.PIPE, text=True))
    stack.callback(central.terminate)
    assert central.stderr
    address = central.stderr.readline().split()[-1]
    server = stack.enter_context(subprocess.Popen([sys.executable, "-c", SERVER, address]))
    stack.callback(server.terminate)
    client = stack.enter_context(connect("user", address, linger=1.0))
    client.wait_until_handled(PING, NOTE, SEEN, timeout=20)
    return client


def round_trip(client: Client) -> float:
    """Return the median time of a query, in seconds."""
    return statistics.median(timed(TRIPS, lambda: client.query(PING, BODY)))


def queries(client: Client) -> float:
    """Return the queries a second, with many open at a time."""
    began = time.perf_counter()
    run_open(MANY, lambda: client.query_send(PING, BODY).receive)
    return MANY / (time.perf_counter() - began)


def informs(client: Client) -> float:
    """Return the informs a second, until the last is handled."""
    before, began = client.query(SEEN), time.perf_counter()
    for _ in range(MANY):
        client.inform(NOTE, BODY, wait=5.0)
    while client.query(SEEN) - before < MANY:
        pass
    return MANY / (time.perf_counter() - began)


def main(rounds: int) -> None:
    measured: dict[str, dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        os.environ |= {"TCA_KEYS": str(folder / "keys"), "TCA_KEY": "user"}
        subprocess.run(
            [sys.executable, "-m", "tca_central.shell.keys_command", "new", "user"], check=True
        )
        clients = {
            "keys": start(stack, "--journal", str(folder / "keys only"), "--no-inputs"),
            "keys, inputs": start(stack, "--journal", str(folder / "both")),
        }
        os.environ["TCA_KEY"] = "none"
        clients["none"] = start(
            stack, "--insecure", "--journal", str(folder / "none"), "--no-inputs"
        )
        for turn in range(rounds + 1):
            for name, client in clients.items():
                for measure in (round_trip, queries, informs):
                    figure = measure(client)
                    if turn:  # the first warms up
                        measured[measure.__name__][name].append(figure)
    for what, by_name in measured.items():
        for name, figures in by_name.items():
            ratio = statistics.median(
                one / other for one, other in zip(figures, by_name["none"], strict=True)
            )
            print(f"{what:11} {name:12} {shown(statistics.median(figures))}  ratio {ratio:.2f}")


def shown(figure: float) -> str:
    return f"{figure * 1e6:8.0f} us" if figure < 1 else f"{figure:8.0f} /s"


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 9)
