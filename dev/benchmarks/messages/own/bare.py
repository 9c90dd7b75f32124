"""Central with bare clients, which speak central's protocol over plain ZeroMQ, without the
library.
"""

import itertools
from pathlib import Path
from typing import Any

import zmq

from dev.benchmarks.messages.contestant import OPEN, Contestant, body_of, check_arrived, timed
from dev.benchmarks.messages.own.library import HEARD, MOVE, PING, POSE, SEEN, SLOTS, TICK
from dev.benchmarks.messages.own.zeromq import Socket, socket
from dev.benchmarks.messages.processes import address_in
from tca_wire.constraints import Flags
from tca_wire.messages.large_data import inline
from tca_wire.packets import codec, headers
from tca_wire.packets.credit import Receipts
from tca_wire.packets.large import is_large
from tca_wire.packets.parts import EndedRun, HandlerFormat
from tca_wire.points import Moment, Point, TaskId

NIL = b"\xc0"
AHEAD = 64
"""The number of messages that central prefetches to a slot."""
_PINGS, _COUNTED = {ping.name for ping in PING.values()}, {POSE.name, TICK.name}
_COUNTS = {one.name for one in (SEEN, *HEARD)}
_ANSWERS = (headers.Accepted, headers.Answer)


_readings: dict[Socket, Receipts] = {}


def read(line: Socket) -> bytes:
    """Return the next packet, and send central its receipt."""
    reading, packet = _readings.setdefault(line, Receipts()), line.recv()
    if receipt := reading.due(packet):
        line.send(receipt)
        reading.sent()
    return packet


def joined(address: str, module: str, number: int = 0, resource: str = "") -> Socket:
    """Return a connection that central has welcomed."""
    line = socket(zmq.DEALER, connect=address)
    hello = headers.Hello(
        1, headers.PROTOCOL_VERSION, module, module, number, resource, prefetch=AHEAD
    )
    line.send(codec.pack_item(hello))
    codec.unpack_to_module(read(line))
    return line


def registered(address: str, module: str, handlers: dict[Any, str]) -> list[Socket]:
    """Return the slots of a module that handles these messages.

    Each resource has one connection, or sixteen.
    """
    own = joined(address, module)
    formats = [message.format for message in handlers]
    handled = [HandlerFormat(message.name, resource) for message, resource in handlers.items()]
    own.send(codec.pack_item(headers.Register(2, formats, handled)))
    read(own)
    names = [
        name
        for name in dict.fromkeys(handlers.values())
        for _ in range(16 if name == SLOTS[16] else 1)
    ]
    return [own, *(joined(address, module, number, name) for number, name in enumerate(names, 1))]


def serve(folder: Path) -> None:
    """Run a module without the library."""
    handlers = {PING[1]: "one", PING[16]: "sixteen", POSE: "one", SEEN: "one", MOVE: "mover"}
    serve_lines(registered(address_in(folder), "server", handlers))


def listen(folder: Path) -> None:
    """Run the modules that receive a broadcast."""
    named = [(f"listener {number}", heard) for number, heard in enumerate(HEARD)]
    serve_lines(
        [
            line
            for name, heard in named
            for line in registered(address_in(folder), name, {TICK: name, heard: name})
        ]
    )


def serve_lines(lines: list[Socket]) -> None:
    """Answer all messages."""
    poller = zmq.Poller()
    counts = dict.fromkeys(lines, 0)
    for line in lines:
        poller.register(line, zmq.POLLIN)
    while True:
        for line, _ in poller.poll():
            if items := answers(line, counts):
                line.send(codec.pack(items))


def answers(line: Socket, counts: dict[Socket, int]) -> list[tuple[Any, bytes]]:
    """Return the answers to the next packet: one for all messages that are no tasks, nor large."""
    items: list[tuple[Any, bytes]] = []
    ended: list[EndedRun] = []
    replies: list[bytes] = []
    for header, body in codec.unpack_to_module(read(line)):
        if isinstance(header, headers.Recall):
            items.append((headers.Recalled([]), b""))  # this slot has started all of its messages
        elif isinstance(header, headers.Deliver):
            reply = handle(line, header.message, body, counts)
            if header.task or is_large(reply):
                items.append((headers.Reply(header.delivery), reply))
            else:
                ended.append(EndedRun(header.delivery, 0.0, 0.0, len(reply)))
                replies.append(reply)
    if ended:
        items.append((headers.Replies(ended), b"".join(replies)))
    return items


def handle(line: Socket, message: str, body: bytes, counts: dict[Socket, int]) -> bytes:
    """Return the reply to a message."""
    if message in _PINGS:
        return body
    if message in _COUNTS:
        seen, counts[line] = counts[line], 0
        return SEEN.encode_reply(seen)
    counts[line] += message in _COUNTED
    return NIL


class BareEnds(Contestant):
    """Client, central and one module."""

    def start(self) -> None:
        journal = str(self.folder / "journal")
        self.broker = self.children.central(self.folder, "--journal", journal)
        self.receiver = self.children.serve(serve, self.folder)
        self.children.serve(listen, self.folder)
        self.line = joined(address_in(self.folder), "client")
        self.numbers = itertools.count(2)
        declared: list[Any] = [*PING.values(), POSE, SEEN, TICK, *HEARD, MOVE]
        self._ask([(headers.Register(next(self.numbers), [one.format for one in declared]), b"")])
        names = [one.name for one in declared]
        self._ask([(headers.WaitUntilHandled(next(self.numbers), names), b"")])

    def _send(self, items: list[tuple[Any, bytes]]) -> None:
        for header, body in items:
            self.line.send(codec.pack_item(header, body))

    def _ask(self, items: list[tuple[Any, bytes]]) -> list[tuple[Any, bytes]]:
        """Send requests, each in a packet of its own, and wait for all answers."""
        self._send(items)
        return self._answers(len(items))

    def _answers(self, number: int) -> list[tuple[Any, bytes]]:
        found: list[tuple[Any, bytes]] = []
        while len(found) < number:
            for header, body in codec.unpack_to_module(read(self.line)):
                if isinstance(header, _ANSWERS) and not getattr(header, "more", False):
                    found.append((header, body))
                assert not isinstance(header, headers.Refused), header
        return found

    def _question(self, message: Any, body: bytes = NIL) -> tuple[Any, bytes]:
        return headers.Send(next(self.numbers), message.name), body

    def round_trip(self, number: int, size: int) -> list[float]:
        body = inline(PING[1].encode_data(body_of(size)))
        return timed(number, lambda: self._ask([self._question(PING[1], body)]))

    def pipelined(self, number: int, slots: int) -> None:
        body = PING[slots].encode_data(body_of(100))
        unanswered = 0
        while number:
            fresh = min(OPEN - unanswered, number - unanswered)
            self._send([self._question(PING[slots], body) for _ in range(fresh)])
            unanswered += fresh
            answered = len(self._answers(1))
            unanswered, number = unanswered - answered, number - answered

    def oneway(self, number: int) -> None:
        body = POSE.encode_data(body_of(100))
        self._send([(headers.Send(0, POSE.name), body)] * number)
        check_arrived(number, *self._counts(SEEN))

    def fanout(self, number: int) -> None:
        body = TICK.encode_data(body_of(100))
        self._send([(headers.Send(0, TICK.name), body)] * number)
        check_arrived(number, *self._counts(*HEARD))

    def _counts(self, *questions: Any) -> list[int]:
        answers = self._ask([self._question(one) for one in questions])
        return [SEEN.decode_reply(body) for _, body in answers]

    def commands(self, number: int) -> list[float]:
        return timed(number, lambda: self._command(1))

    def commands_open(self, number: int) -> None:
        for begun in range(0, number, OPEN):
            self._command(min(OPEN, number - begun))

    def _command(self, number: int) -> None:
        """Send *number* commands at once: wait for their ids first, then for their ends."""
        body = MOVE.encode_data(body_of(100))
        sends = [
            (headers.Send(next(self.numbers), MOVE.name, flags=Flags.NONE), body)
            for _ in range(number)
        ]
        points = [
            Point(TaskId(accepted.id), Moment.END_ACHIEVING) for accepted, _ in self._ask(sends)
        ]
        self._ask([(headers.AwaitPoint(next(self.numbers), point), b"") for point in points])
