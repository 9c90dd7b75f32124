"""ZeroMQ alone: ``zmq.proxy``, which only forwards frames (our limit), and no broker at all."""

import threading
from pathlib import Path

import zmq

from dev.benchmarks.messages.contestant import (
    COUNT,
    ECHO,
    LISTENERS,
    MARK,
    OPEN,
    NotThere,
    body_of,
    check_arrived,
    timed,
    until,
)
from dev.benchmarks.messages.images import Frame, Showing, Viewer

Socket = zmq.Socket[bytes]


def socket(
    kind: int, *, bind: str = "", connect: str = "", topics: tuple[bytes, ...] = ()
) -> Socket:
    """Return a socket without limits for its queues."""
    made: Socket = zmq.Context.instance().socket(kind)
    made.setsockopt(zmq.LINGER, 0)
    made.set_hwm(0)
    for topic in topics:
        made.setsockopt(zmq.SUBSCRIBE, topic)
    if bind:
        made.bind(bind)
    else:
        made.connect(connect)
    return made


def address_of(folder: Path, name: str) -> str:
    """Return the address of a socket."""
    return f"ipc://{folder}/{name}"


def forward(folder: Path) -> None:
    """Run the broker: a proxy for single messages and, in a thread, one for broadcasts."""
    publishers = socket(zmq.XSUB, bind=address_of(folder, "pub"))
    subscribers = socket(zmq.XPUB, bind=address_of(folder, "sub"))
    threading.Thread(target=zmq.proxy, args=(publishers, subscribers), daemon=True).start()
    zmq.proxy(
        socket(zmq.ROUTER, bind=address_of(folder, "front")),
        socket(zmq.DEALER, bind=address_of(folder, "back")),
    )


def serve_proxy(folder: Path) -> None:
    """Run the server behind the proxy."""
    answer(socket(zmq.DEALER, connect=address_of(folder, "back")))


def serve_directly(folder: Path) -> None:
    """Run the server without a proxy."""
    answer(socket(zmq.ROUTER, bind=address_of(folder, "front")))


def answer(line: Socket) -> None:
    """Send back some messages, count the others."""
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
    """Run the subscribers, which count published messages and report the number."""
    counts = socket(zmq.PUSH, connect=address_of(folder, "counts"))
    place = address_of(folder, "sub")
    subscribers = {
        socket(zmq.SUB, connect=place, topics=(COUNT, MARK)): 0 for _ in range(LISTENERS)
    }
    poller = zmq.Poller()
    for subscriber in subscribers:
        poller.register(subscriber, zmq.POLLIN)
    while True:
        for subscriber, _ in poller.poll():
            _read_all(subscriber, subscribers, counts)


def _read_all(subscriber: Socket, subscribers: dict[Socket, int], counts: Socket) -> None:
    """Read all messages that have arrived."""
    try:
        while True:
            if subscriber.recv(zmq.NOBLOCK)[:1] == MARK:
                counts.send(str(subscribers[subscriber]).encode())
                subscribers[subscriber] = 0
            else:
                subscribers[subscriber] += 1
    except zmq.Again:
        pass


def watch(folder: Path, topic: str, path: str) -> None:
    """Run a viewer."""
    viewer = Viewer(path)
    line = socket(zmq.SUB, connect=address_of(folder, "sub"), topics=(topic.encode(),))
    while True:
        viewer(line.recv_multipart()[1])


class Proxy(Showing):
    """Client, proxy and server. Commands are only messages here, without a record."""

    def start(self) -> None:
        self._start_others()
        self.children.serve(listen, self.folder)
        self.counts = socket(zmq.PULL, bind=address_of(self.folder, "counts"))
        self.line = socket(zmq.DEALER, connect=address_of(self.folder, "front"))

    def _start_others(self) -> None:
        self.broker = self.children.serve(forward, self.folder)
        self.receiver = self.children.serve(serve_proxy, self.folder)
        self.publisher = socket(zmq.PUB, connect=address_of(self.folder, "pub"))

    def ready(self) -> None:
        super().ready()
        until(self._check_all_subscribed)

    def _check_all_subscribed(self) -> None:
        self.publisher.send(MARK)
        for _ in range(LISTENERS):
            if not self.counts.poll(200):
                raise NotThere("not all listeners are connected yet")
            self.counts.recv()

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
        check_arrived(number, *(int(self.counts.recv()) for _ in range(LISTENERS)))

    def start_viewer(self, topic: str, path: str) -> int:
        return self.children.serve(watch, self.folder, topic, path)

    def show(self, topic: str, frame: Frame) -> None:
        self.publisher.send_multipart([topic.encode(), frame.data])

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
        self.receiver = self.children.serve(serve_directly, self.folder)
        self.publisher = socket(zmq.PUB, bind=address_of(self.folder, "sub"))
