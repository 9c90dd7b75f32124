"""ZeroMQ alone: ``zmq.proxy``, which forwards frames and knows nothing (our limit), and no broker
at all.
"""

import threading
from pathlib import Path

import zmq

from dev.benchmarks.messages.contestant import (
    COUNT,
    ECHO,
    LISTENERS,
    MARK,
    OPEN,
    Contestant,
    NotThere,
    body_of,
    check_arrived,
    timed,
    until,
)

Socket = zmq.Socket[bytes]


def socket(kind: int, *, bind: str = "", connect: str = "") -> Socket:
    """A socket that queues whatever comes."""
    made: Socket = zmq.Context.instance().socket(kind)
    made.setsockopt(zmq.LINGER, 0)
    made.set_hwm(0)
    if kind == zmq.SUB:
        made.setsockopt(zmq.SUBSCRIBE, b"")
    if bind:
        made.bind(bind)
    else:
        made.connect(connect)
    return made


def at(folder: Path, name: str) -> str:
    """The address of a socket."""
    return f"ipc://{folder}/{name}"


def forward(folder: Path) -> None:
    """The broker: a proxy for messages to one, in a thread one for those to many."""
    publishers, subscribers = (
        socket(zmq.XSUB, bind=at(folder, "pub")),
        socket(zmq.XPUB, bind=at(folder, "sub")),
    )
    threading.Thread(target=zmq.proxy, args=(publishers, subscribers), daemon=True).start()
    zmq.proxy(
        socket(zmq.ROUTER, bind=at(folder, "front")), socket(zmq.DEALER, bind=at(folder, "back"))
    )


def serve_proxy(folder: Path) -> None:
    """The server behind the proxy."""
    answer(socket(zmq.DEALER, connect=at(folder, "back")))


def serve_directly(folder: Path) -> None:
    """The server where there is no proxy."""
    answer(socket(zmq.ROUTER, bind=at(folder, "front")))


def answer(line: Socket) -> None:
    """Send back what is to be sent back, count the others."""
    count = 0
    while True:
        sender, body = line.recv(), line.recv()
        if body[:1] == COUNT:
            count += 1
            continue
        line.send(sender, zmq.SNDMORE)
        line.send(body if body[:1] == ECHO else str(count).encode())
        count = 0


def listen(folder: Path) -> None:
    """Those who hear what is published, and tell how much that was."""
    told = socket(zmq.PUSH, connect=at(folder, "told"))
    ears = {socket(zmq.SUB, connect=at(folder, "sub")): 0 for _ in range(LISTENERS)}
    poller = zmq.Poller()
    for ear in ears:
        poller.register(ear, zmq.POLLIN)
    while True:
        for ear, _ in poller.poll():
            _hear(ear, ears, told)


def _hear(ear: Socket, ears: dict[Socket, int], told: Socket) -> None:
    """All that is there already."""
    try:
        while True:
            if ear.recv(zmq.NOBLOCK)[:1] == MARK:
                told.send(str(ears[ear]).encode())
                ears[ear] = 0
            else:
                ears[ear] += 1
    except zmq.Again:
        pass


class Proxy(Contestant):
    """Client, proxy and server; commands are what moves their messages, nobody keeps a record of
    them.
    """

    def start(self) -> None:
        self._start_others()
        self.children.serve(listen, self.folder)
        self.told = socket(zmq.PULL, bind=at(self.folder, "told"))
        self.line = socket(zmq.DEALER, connect=at(self.folder, "front"))

    def _start_others(self) -> None:
        self.children.serve(forward, self.folder)
        self.children.serve(serve_proxy, self.folder)
        self.publisher = socket(zmq.PUB, connect=at(self.folder, "pub"))

    def ready(self) -> None:
        super().ready()
        until(self._check_all_hear)

    def _check_all_hear(self) -> None:
        self.publisher.send(MARK)
        for _ in range(LISTENERS):
            if not self.told.poll(200):
                raise NotThere("not all listeners are connected yet")
            self.told.recv()

    def round_trip(self, number: int, size: int) -> list[float]:
        body = body_of(size)

        def exchange() -> None:
            self.line.send(body)
            self.line.recv()

        return timed(number, exchange)

    def pipelined(self, number: int, slots: int) -> None:
        del slots
        body = body_of(100)
        for _ in range(OPEN):
            self.line.send(body)
        for _ in range(number - OPEN):
            self.line.recv()
            self.line.send(body)
        for _ in range(OPEN):
            self.line.recv()

    def oneway(self, number: int) -> None:
        body = body_of(100, COUNT)
        for _ in range(number):
            self.line.send(body)
        self.line.send(MARK)
        check_arrived(number, int(self.line.recv()))

    def fanout(self, number: int) -> None:
        body = body_of(100, COUNT)
        for _ in range(number):
            self.publisher.send(body)
        self.publisher.send(MARK)
        check_arrived(number, *(int(self.told.recv()) for _ in range(LISTENERS)))

    def commands(self, number: int) -> list[float]:
        return self.round_trip(number, 100)

    def commands_open(self, number: int) -> None:
        self.pipelined(number, 1)

    def goals(self, number: int) -> list[float]:
        return timed(number, lambda: self.round_trip(4, 100))

    def chain(self, number: int) -> None:
        self.round_trip(number, 100)


class Brokerless(Proxy):
    """Client and server alone."""

    def _start_others(self) -> None:
        self.children.serve(serve_directly, self.folder)
        self.publisher = socket(zmq.PUB, bind=at(self.folder, "sub"))
