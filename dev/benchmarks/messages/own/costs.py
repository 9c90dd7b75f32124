"""The costs of central beside time: memory, and the time to start."""

import itertools
import resource
import subprocess
import sys
import time
from typing import Any

import zmq

from dev.benchmarks.messages.contestant import SOON, Contestant, body_of
from dev.benchmarks.messages.own.bare import joined, registered
from dev.benchmarks.messages.own.started import PING, serve
from dev.benchmarks.messages.own.zeromq import Socket
from dev.benchmarks.messages.processes import address_in, resident_bytes
from tca_module import Goal, Inform, connect
from tca_wire.constraints import Flags
from tca_wire.packets import codec, headers

MANY = 10_000
"""The limit for connections of one process."""
WALK, NOTE = Goal("walk", bytes), Inform("note", bytes)


class Memory(Contestant):
    """Central, a handler that never returns, and a bare client, to measure central's memory."""

    def __init__(self, of: str) -> None:
        super().__init__()
        #: Modules are costly: only a part of the given number is added.
        self.add, self.part = {
            "a waiting goal": (self._add_goals, 1.0),
            "a waiting inform": (self._add_informs, 1.0),
            "a connected module": (self._add_modules, 0.05),
        }[of]
        self.modules: list[Socket] = []

    def start(self) -> None:
        zmq.Context.instance().set(zmq.MAX_SOCKETS, MANY)
        _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
        self.central = self.children.central(self.folder, "--no-journal")
        address = address_in(self.folder)
        self.busy = registered(address, "busy", {WALK: "busy", NOTE: "busy"})
        self.line, self.numbers = joined(address, "client"), itertools.count(2)
        self._ask(headers.Register(next(self.numbers), [WALK.format, NOTE.format]))

    def ready(self) -> None:
        self._add_goals(1)  # this goal occupies the handler, so that nothing else is handled
        self.add(20)

    def _ask(self, header: Any, body: bytes = b"") -> None:
        self.line.send(codec.pack_item(header, body))
        ((answer, _),) = codec.unpack_to_module(self.line.recv())
        assert isinstance(answer, headers.Accepted), answer

    def _add_goals(self, number: int) -> None:
        for _ in range(number):
            self._ask(
                headers.Send(next(self.numbers), WALK.name, flags=Flags.NONE),
                WALK.encode_data(body_of(100)),
            )

    def _add_informs(self, number: int) -> None:
        for _ in range(number):
            self._ask(headers.Send(next(self.numbers), NOTE.name), NOTE.encode_data(body_of(100)))

    def _add_modules(self, number: int) -> None:
        for _ in range(number):
            name = f"module {len(self.modules)}"
            self.modules += registered(
                address_in(self.folder), name, {Inform(f"to {name}", int): name}
            )

    def memory(self, number: int) -> tuple[float]:
        """Return the bytes of memory that each of *number* more objects takes."""
        self.children.close()
        for line in (*self.modules, *self.busy, self.line):
            line.close()
        self.modules.clear()
        self.start()  # a new central: an old one would reuse freed memory
        self.ready()
        before, more = resident_bytes(self.central), max(int(number * self.part), 1)
        self.add(more)
        return ((resident_bytes(self.central) - before) / more,)


class Started(Contestant):
    """A program that is started again and again. A start is timed until the program does its
    work.
    """

    def __init__(self, what: str) -> None:
        super().__init__()
        self.act = {"python": self._python, "central": self._central, "module": self._module}[what]
        self.is_module = what == "module"

    def start(self) -> None:
        if self.is_module:
            self.children.central(self.folder, "--no-journal")
            self.client = connect("bench", address_in(self.folder), SOON)

    def ready(self) -> None:
        self.act()

    def stop(self) -> None:
        if self.is_module:
            self.client.close()
        super().stop()

    def start_up(self, number: int) -> list[float]:
        """Return the seconds of each start."""
        return [self.act() for _ in range(number)]

    def _python(self) -> float:
        begin = time.perf_counter()
        subprocess.run([sys.executable, "-c", "import zmq, msgspec"], check=True)
        return time.perf_counter() - begin

    def _central(self) -> float:
        folder = self.folder / str(time.monotonic_ns())
        folder.mkdir()
        begin = time.perf_counter()
        central = self.children.central(folder, "--no-journal")
        client = connect("bench", address_in(folder), SOON)
        took = time.perf_counter() - begin
        client.close()
        self.children.stop_one(central)
        return took

    def _module(self) -> float:
        begin = time.perf_counter()
        module = self.children.serve(serve, address_in(self.folder))
        self.client.wait_until_handled(PING, timeout=SOON)
        self.client.query(PING, body_of(100))
        took = time.perf_counter() - begin
        self.children.stop_one(module)
        return took
