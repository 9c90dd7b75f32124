"""Queries and goals through central beside the same exchange through ``zmq.proxy``, in one run.

    python -m benchmarks.messaging [--rounds 3] [--seconds 1.0]

Every contestant has three processes: client, broker, server; 100-byte bodies, Unix sockets. The proxy's ends are
bare pyzmq; central's are the module library, with types checked at both ends. Ratios hold, absolute figures are this
machine's.
"""

import argparse
import itertools
import multiprocessing
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import zmq

from tca_module import Goal, Module, Query, Task, connect
from tca_wire.packets import codec, headers
from tca_wire.packets.parts import HandlerFormat

PING = Query("ping", bytes, reply=bytes)
WALK = Goal("walk", bytes)
BODY = bytes(100)
OUTSTANDING = 100
CAPACITY = 16
"""Queries that the server may have at a time: central waits for one answer before it gives a slot the next."""


def serve_module(address: str) -> None:
    module = Module("server", address, capacity=CAPACITY)

    @module.handles(PING)
    def ping(_: Task, body: bytes) -> bytes:
        return body

    @module.handles(WALK, resource="walker")
    def walk(_: Task, body: bytes) -> None:
        del body

    module.run()


def dealer(address: str) -> "zmq.Socket[bytes]":
    socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.DEALER)
    socket.connect(address)
    return socket


def serve_echo(address: str) -> None:
    socket = dealer(address)
    while True:
        socket.send_multipart(socket.recv_multipart())


def run_proxy(front: str, back: str) -> None:
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context.instance()
    clients, servers = context.socket(zmq.ROUTER), context.socket(zmq.DEALER)
    clients.bind(front)
    servers.bind(back)
    zmq.proxy(clients, servers)


@contextmanager
def process(target: Callable[..., None], *arguments: str) -> Iterator[None]:
    running = multiprocessing.get_context("spawn").Process(target=target, args=arguments, daemon=True)
    running.start()
    try:
        yield
    finally:
        running.terminate()
        running.join()


@contextmanager
def central(folder: Path, *options: str) -> Iterator[str]:
    address = f"ipc://{folder}/central.sock"
    running = subprocess.Popen([sys.executable, "-m", "tca_central", "--quiet", "--bind", address, *options])
    try:
        yield address
    finally:
        running.terminate()
        running.wait()


def rate(seconds: float, do: Callable[[], int]) -> float:
    """How often per second; *do* says how much it did."""
    done, begin = 0, time.perf_counter()
    while (passed := time.perf_counter() - begin) < seconds:
        done += do()
    return done / passed


def timed(exchange: Callable[[int], int], seconds: float) -> dict[str, float]:
    """Exchanges one at a time, and many at once."""
    exchange(OUTSTANDING)
    return {
        "round trip": 1e6 / rate(seconds, lambda: exchange(1)),
        "queries": rate(seconds, lambda: exchange(OUTSTANDING)),
    }


def measure_proxy(seconds: float) -> dict[str, float]:
    with tempfile.TemporaryDirectory() as folder:
        front, back = f"ipc://{folder}/front", f"ipc://{folder}/back"
        with process(run_proxy, front, back), process(serve_echo, back):
            socket = dealer(front)

            def exchange(count: int) -> int:
                for _ in range(count):
                    socket.send(BODY)
                for _ in range(count):
                    socket.recv()
                return count

            result = timed(exchange, seconds)
            socket.close(linger=0)
    return result


def measure_central(seconds: float, *options: str) -> dict[str, float]:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        journal = options or ("--journal", str(folder / "journal"))
        with central(folder, *journal) as address, process(serve_module, address), connect("client", address) as client:
            client.query(PING, BODY)

            def exchange() -> int:
                pending = [client.query_send(PING, BODY) for _ in range(OUTSTANDING)]
                for reply in pending:
                    reply.receive()
                return OUTSTANDING

            def goals() -> int:
                client.goal(WALK, BODY, sequential=False)
                return 1

            def one() -> int:
                client.query(PING, BODY)
                return 1

            exchange()
            result = {"round trip": 1e6 / rate(seconds, one), "queries": rate(seconds, exchange)}
            result["goals"] = rate(seconds, goals)
    return result


def serve_bare(address: str) -> None:
    """A module by hand, without the module library."""
    slots = [dealer(address) for _ in range(CAPACITY + 1)]
    for number, slot in enumerate(slots):
        hello = headers.Hello(1, headers.PROTOCOL_VERSION, "bare", "bare", number, "bare" if number else "")
        slot.send(codec.pack_item(hello))
        slot.recv()
    messages, handlers = [PING.format], [HandlerFormat("ping", "bare")]
    slots[0].send(codec.pack_item(headers.Register(2, messages, handlers)))
    slots[0].recv()
    poller = zmq.Poller()
    for slot in slots[1:]:
        poller.register(slot, zmq.POLLIN)
    while True:
        for slot, _ in poller.poll():
            for header, body in codec.unpack_to_module(slot.recv()):
                if isinstance(header, headers.Deliver):
                    slot.send(codec.pack_item(headers.Reply(header.delivery), body))


def measure_bare(seconds: float) -> dict[str, float]:
    """Central without the module library: both ends speak the protocol over bare pyzmq."""
    with tempfile.TemporaryDirectory() as name:  # noqa: SIM117
        with central(Path(name), "--no-journal") as address, process(serve_bare, address):
            socket = dealer(address)
            socket.send(codec.pack_item(headers.Hello(1, headers.PROTOCOL_VERSION, "client", "client")))
            socket.recv()
            socket.send(codec.pack_item(headers.Register(2, [PING.format])))
            socket.recv()
            numbers, body = itertools.count(3), PING.encode_data(BODY)

            def exchange(count: int) -> int:
                for _ in range(count):
                    socket.send(codec.pack_item(headers.Send(next(numbers), "ping"), body))
                answered = 0
                while answered < count:
                    items = codec.unpack_to_module(socket.recv())
                    answered += sum(isinstance(header, headers.Answer) for header, _ in items)
                return count

            result = timed(exchange, seconds)
            socket.close(linger=0)
    return result


CONTESTANTS: dict[str, Callable[[float], dict[str, float]]] = {
    "zmq.proxy": measure_proxy,
    "central, bare ends": measure_bare,
    "central, no journal": lambda seconds: measure_central(seconds, "--no-journal"),
    "central": measure_central,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=1.0)
    options = parser.parse_args()
    results: dict[str, list[dict[str, float]]] = {name: [] for name in CONTESTANTS}
    for _ in range(options.rounds):
        for name, measure in CONTESTANTS.items():
            results[name].append(measure(options.seconds))
    print(f"{'median of ' + str(options.rounds):>20} {'round trip, us':>15} {'queries/s, 100 open':>20} {'goals/s':>9}")
    best = {}
    for name, rounds in results.items():
        best[name] = {key: statistics.median(result[key] for result in rounds) for key in rounds[0]}
        goals = f"{best[name]['goals']:>9,.0f}" if "goals" in best[name] else f"{'-':>9}"
        print(f"{name:>20} {best[name]['round trip']:>15.0f} {best[name]['queries']:>20,.0f} {goals}")
    one, other = best["central"], best["zmq.proxy"]
    print(f"central / zmq.proxy: round trip {one['round trip'] / other['round trip']:.2f}, "
          f"queries/s {one['queries'] / other['queries']:.2f}")  # fmt: skip


if __name__ == "__main__":
    main()
