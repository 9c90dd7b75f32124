"""The line between a sender and an entrance, without sockets, and its two ends."""

import logging
from collections import deque

from tca_module.direct.inbox import Inbox
from tca_module.direct.note_batch import NoteBatch
from tca_module.direct.path import DirectPath
from tca_module.session.request import Request
from tca_wire.packets.headers import Reply, Send
from tca_wire.packets.routes import Entrance

KEY = "key"


class Line:
    """A line that can break: what is on its way is lost then, and the far end knows the sender under a new address."""

    def __init__(self) -> None:
        self.there: deque[tuple[bytes, list[bytes]]] = deque()
        self.back: deque[bytes] = deque()
        self.number = 1
        self.is_connected = True

    @property
    def address(self) -> bytes:
        return b"%d" % self.number

    def cut(self) -> None:
        self.there.clear()
        self.back.clear()
        self.number += 1


class Near:
    """The sender's socket."""

    def __init__(self, line: Line) -> None:
        self.line = line

    @property
    def is_connected(self) -> bool:
        return self.line.is_connected

    def send(self, packet: bytes) -> bool:
        if self.line.is_connected:
            self.line.there.append((self.line.address, [packet]))
        return self.line.is_connected

    def receive(self) -> bytes | None:
        return self.line.back.popleft() if self.line.back else None

    def fileno(self) -> int:
        raise NotImplementedError

    def has_arrived(self) -> bool:
        return bool(self.line.back)

    def close(self) -> None:
        """Nothing to close."""


class Far:
    """The entrance's socket."""

    def __init__(self, line: Line) -> None:
        self.line = line
        self.is_paused = False

    def send(self, to: bytes, packet: bytes) -> bool:
        if to == self.line.address:
            self.line.back.append(packet)
        return to == self.line.address

    def receive(self) -> tuple[bytes, list[bytes]] | None:
        return self.line.there.popleft() if self.line.there else None

    def close(self) -> None:
        """Nothing to close."""


class Pair:
    """A sender and a slot."""

    def __init__(self) -> None:
        self.now = 0.0
        self.line = Line()
        self.notes = NoteBatch()
        self.inbox = Inbox(
            Far(self.line), KEY, {"height": True, "pose": False}, self.notes, lambda: self.now, logging.getLogger("t")
        )
        self.over: list[Request] = []
        self.handed_over: list[Request] = []
        self.lost: list[str] = []
        self.handled: list[bytes] = []
        self.path = DirectPath(
            Entrance("ipc:///there", KEY), Near(self.line), "run/0/1", "user",
            end=self.end, hand_over=self.handed_over.append, lose=self.lost.append,
        )  # fmt: skip

    def end(self, request: Request) -> None:
        assert not request.is_over
        request.is_over = True
        self.over.append(request)

    def ask(self, body: bytes = b"?") -> Request:
        request = Request(Send(0, "height"), body, wants_answer=True)
        assert self.path.ask(request, self.now)
        return request

    def greet(self) -> None:
        self.path.tend(self.now)
        self.inbox.listen()
        self.path.receive()

    def handle(self) -> None:
        """The slot handles one message, if there is one."""
        self.inbox.listen()
        if (taken := self.inbox.take()) is not None:
            delivery, body = taken
            self.handled.append(body)
            self.inbox.reply(Reply(delivery.delivery), body)

    def settle(self) -> None:
        """Let enough time pass, and everything be handled."""
        for _ in range(4):
            self.now += 1.1
            for _ in range(60):
                self.path.tend(self.now)
                self.handle()
                self.path.receive()
