"""Central with the module library, as users have it."""

import contextlib
import threading
import time
from pathlib import Path
from typing import Any

from dev.benchmarks.messages.contestant import (
    LISTENERS,
    SOON,
    body_of,
    check_arrived,
    run_open,
    timed,
)
from dev.benchmarks.messages.images import ONE, THREE, Frame, Showing, Viewer
from dev.benchmarks.messages.processes import address_in, processor_seconds
from tca_module import Broadcast, Command, Condition, Goal, Inform, Module, Query, Task, connect

SLOTS = {1: "one", 16: "sixteen"}
"""The resources of the server, by capacity."""
PING = {number: Query(f"ping {name}", bytes, reply=bytes) for number, name in SLOTS.items()}
POSE, SEEN = Inform("pose", bytes), Query("seen", reply=int)
TICK = Broadcast("tick", bytes)
HEARD = [Query(f"heard {number}", reply=int) for number in range(LISTENERS)]
MOVE = Command("move", bytes)
THREE_MOVES, MANY_MOVES = Goal("three moves", bytes), Goal("many moves", int)
NOTES = [Inform(f"note {number}", bytes) for number in range(10)]
IMAGE, IMAGES = Inform("image", Frame), Broadcast("images", Frame)
JOURNALS = {"off": ("--no-journal",), "batch": ("--sync", "batch"), "always": ("--sync", "always")}
TOGETHER = 50
"""The modules of a crowd that share a process."""


def serve(address: str) -> None:
    """Run the module that handles everything but the broadcast."""
    server = Module("server", address)
    for number, name in SLOTS.items():
        server.resource(name, number)
        server.handles(PING[number], resource=name)(lambda _, body: body)
    add_counter(server, POSE, SEEN, "one")
    server.handles(MOVE, resource="mover")(lambda _, __: None)
    for note in NOTES:
        server.handles(note, resource="listener")(lambda _, __: None)

    @server.handles(THREE_MOVES)
    def three_moves(task: Task, body: bytes) -> None:
        for _ in range(3):
            task.command(MOVE, body)

    @server.handles(MANY_MOVES)
    def many_moves(task: Task, number: int) -> None:
        body = body_of(100)
        for _ in range(number):
            task.command(MOVE, body)

    server.run(patience=SOON)


def add_counter(module: Module, counted: Any, question: Query[None, int], resource: str) -> None:
    """Count messages, and reply with the number since the last query."""
    count = 0

    def count_one(_: Task, __: bytes) -> None:
        nonlocal count
        count += 1

    def report_count(_: Task) -> int:
        nonlocal count
        seen, count = count, 0
        return seen

    module.handles(counted, resource=resource)(count_one)
    module.handles(question, resource=resource)(report_count)


def run_together(*modules: Module) -> None:
    """Run several modules in this process, until it is stopped."""
    with contextlib.ExitStack() as stack:
        for module in modules:
            stack.enter_context(module.running(patience=SOON))
        threading.Event().wait()


def listen(address: str) -> None:
    """Run the modules that receive the broadcast."""
    listeners = [Module(f"listener {number}", address) for number in range(LISTENERS)]
    for listener, heard in zip(listeners, HEARD, strict=True):
        add_counter(listener, TICK, heard, listener.name)
    run_together(*listeners)


def watch(address: str, topic: str, path: str) -> None:
    """Run a module that is a viewer."""
    module, viewer = Module(f"viewer {Path(path).name}", address), Viewer(path)
    message: Any = {ONE: IMAGE, THREE: IMAGES}[topic]
    module.handles(message)(lambda _, frame: viewer(frame))
    module.run(patience=SOON)


def idle(address: str, first: int, number: int) -> None:
    """Run modules that have nothing to do."""
    modules = [Module(f"idle {first + one}", address) for one in range(number)]
    for module in modules:
        module.handles(Inform(f"to {module.name}", int))(lambda _, __: None)
    run_together(*modules)


class Library(Showing):
    """Client, central and one module; its listeners have a process of their own."""

    def __init__(self, journal: str = "batch", taps: int = 0, crowd: int = 0) -> None:
        super().__init__()
        self.journal, self.taps, self.crowd = journal, taps, crowd

    def start(self) -> None:
        address = address_in(self.folder)
        journal = () if self.journal == "off" else ("--journal", str(self.folder / "journal"))
        self.broker = self.children.central(self.folder, *self.log_options(), *journal)
        self.receiver = self.children.serve(serve, address)
        if not self.crowd:
            self.children.serve(listen, address)
        sizes = [
            (first, min(TOGETHER, self.crowd - first)) for first in range(0, self.crowd, TOGETHER)
        ]
        self.idle = [self.children.serve(idle, address, *size) for size in sizes]
        self.client = connect("bench", address, SOON)
        for note in NOTES[: self.taps]:
            self.client.tap(Condition.WHILE_HANDLING, PING[1], note)

    def log_options(self) -> tuple[str, ...]:
        """Return central's options for its logs."""
        return JOURNALS[self.journal]

    def stop(self) -> None:
        if hasattr(self, "client"):
            self.client.close()
        super().stop()

    def ready(self) -> None:
        messages: list[Any] = [*PING.values(), POSE, SEEN, MOVE, THREE_MOVES, MANY_MOVES, *NOTES]
        messages += [] if self.crowd else [TICK, *HEARD]
        self.client.wait_until_handled(*messages, timeout=SOON)
        end = time.monotonic() + SOON
        while len(self.client.modules()) < self.crowd and time.monotonic() < end:
            time.sleep(0.2)
        self.round_trip(10, 100)

    def round_trip(self, number: int, size: int) -> list[float]:
        body, ping = body_of(size), PING[1]
        return timed(number, lambda: self.client.query(ping, body))

    def pipelined(self, number: int, slots: int) -> None:
        ping, body = PING[slots], body_of(100)
        run_open(number, lambda: self.client.query_send(ping, body).receive)

    def oneway(self, number: int) -> None:
        body = body_of(100)
        for _ in range(number):
            self.client.inform(POSE, body)
        check_arrived(number, self.client.query(SEEN))

    def fanout(self, number: int) -> None:
        body = body_of(100)
        for _ in range(number):
            self.client.broadcast(TICK, body)
        pending = [self.client.query_send(heard) for heard in HEARD]
        check_arrived(number, *(reply.receive() for reply in pending))

    def start_viewer(self, topic: str, path: str) -> int:
        return self.children.serve(watch, address_in(self.folder), topic, path)

    def show(self, topic: str, frame: Frame) -> None:
        if topic == ONE:
            self.client.inform(IMAGE, frame)
        else:
            self.client.broadcast(IMAGES, frame)

    def journal_bytes(self) -> int | None:
        if self.journal == "off":
            return None
        files = (self.folder / "journal").rglob("*")
        return sum(path.stat().st_size for path in files if path.is_file())

    def commands(self, number: int) -> list[float]:
        body = body_of(100)
        return timed(number, lambda: self.client.command(MOVE, body, sequential=False).result())

    def commands_open(self, number: int) -> None:
        body = body_of(100)
        run_open(number, lambda: self.client.command(MOVE, body, sequential=False).result)

    def goals(self, number: int) -> list[float]:
        body = body_of(100)
        return timed(number, lambda: self.client.goal(THREE_MOVES, body, sequential=False).wait())

    def chain(self, number: int) -> None:
        self.client.goal(MANY_MOVES, number, sequential=False).wait()

    def idle_load(self, number: int) -> tuple[float]:
        """Return the share of a processor, in per cent, that the idle crowd uses.

        It is measured for *number* seconds.
        """
        before = sum(map(processor_seconds, self.idle))
        time.sleep(number)
        return ((sum(map(processor_seconds, self.idle)) - before) / number * 100,)
