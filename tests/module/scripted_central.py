"""A scripted central: a transport whose far end answers each header. Its clock is its own."""

import contextlib
import math
from collections.abc import Callable

from tca_module.link.connection import Connection
from tca_module.session.session import Session
from tca_module.sockets.transport import OneAddress, Waker
from tca_wire.packets.codec import pack, unpack_to_central
from tca_wire.packets.headers import (
    PROTOCOL_VERSION,
    Accepted,
    Beat,
    Hello,
    Register,
    Send,
    ToCentral,
    ToModule,
    Unregister,
    Welcome,
)
from tca_wire.vocabulary import Limit

WELCOME = Welcome(1, 1, "legs", "one")

Script = Callable[[ToCentral], list[ToModule]]


class ScriptedCentral(OneAddress):
    """A transport whose far end answers each header with *script*. Waiting takes time on the
    transport's own clock.
    """

    address = "ipc://scripted"
    hold_seconds = 0.0

    def __init__(self, script: Script) -> None:
        self.script = script
        self.now = 100.0
        self.received: list[ToCentral] = []
        self.packets: list[tuple[float, bytes]] = []
        self.is_present = True
        self.sizes: list[int] = []  # the number of headers in each packet that was received
        self.woken = 0  # how often ``wake`` was called
        self.room = -1  # packets that central still accepts; -1: any number

    def deliver(self, *headers: ToModule, at: float = 0.0) -> None:
        """Let headers arrive, not before the time *at*."""
        self.packets.append((at, pack((header, b"") for header in headers)))

    def beat(self) -> None:
        """Send a beat every second, for a while."""
        for second in range(100):
            self.deliver(Beat(), at=self.now + second)

    def send(self, packet: bytes, wait_seconds: float) -> bool:
        self.is_present, self.room = self.is_present and self.room != 0, self.room - 1
        if not self.is_present:
            self.now += wait_seconds
            return False
        assert len(packet) <= Limit.PACKET
        items = unpack_to_central(packet)
        self.sizes.append(len(items))
        for header, _ in items:
            self.received.append(header)
            if answers := self.script(header):
                self.deliver(*answers)
        return True

    def receive(self, timeout_seconds: float, alarm: float = math.inf) -> bytes | None:
        timeout_seconds = max(0.0, min(timeout_seconds, alarm - self.now))
        if self.packets and self.packets[0][0] <= self.now + timeout_seconds:
            at, packet = self.packets.pop(0)
            self.now = max(self.now, at)
            return packet
        self.now += timeout_seconds
        return None

    def time(self) -> float:
        return self.now

    def seconds_until(self, moment: float) -> float:
        return moment - self.now

    def pausing(self) -> contextlib.AbstractContextManager[None]:
        return contextlib.nullcontext()

    def has_arrived(self) -> bool:
        return bool(self.packets)

    def files(self) -> list[int]:
        raise AssertionError

    def waker(self) -> Waker:
        raise AssertionError

    def wake(self) -> None:
        self.woken += 1

    def close(self) -> None:
        pass


def accept_all(header: ToCentral) -> list[ToModule]:
    """Answer as a central that accepts everything but answers no question."""
    if isinstance(header, Hello):
        return [WELCOME]
    if isinstance(header, Send) and header.number and header.message == "walk":
        return [Accepted(header.number, 17)]
    if isinstance(header, Register | Unregister):
        return [Accepted(header.number)]
    return []


HELLO = Hello(1, PROTOCOL_VERSION, "legs", "run")


def scripted_connection(script: Script = accept_all) -> tuple[Connection, ScriptedCentral]:
    central = ScriptedCentral(script)
    connection = Connection(central, Session(HELLO), clock=lambda: central.now)
    connection.open()
    central.received.clear()
    central.sizes.clear()
    return connection, central
