"""Idle programs use no processor time. Modules sleep until something is due, and central sends them
nothing.
"""

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import zmq
from module.real_central import SOON, RealCentral, until
from module.scripted_central import HELLO, ScriptedCentral, accept_all

from tca_central.shell import server
from tca_module import Command, Module, Query, Task, connect
from tca_module.link.connection import Connection
from tca_module.serving import coroutine_waits
from tca_module.session.session import IDLE, Session
from tca_module.sockets.transport import DealerTransport
from tca_module.testing import LocalCentral
from tca_wire.packets import codec, headers
from tca_wire.packets.headers import Accepted, Beat, Hello, Register, Send, Unknown, Welcome
from tca_wire.points import Moment, Point

WALK, UNHANDLED = Command("walk"), Query("nobody", reply=int)


class CountedCentral(ScriptedCentral):
    """A scripted central that counts the ends of its waits."""

    wakes = 0

    def receive(self, timeout_seconds: float, alarm: float = math.inf) -> bytes | None:
        self.wakes += timeout_seconds > 0
        return super().receive(timeout_seconds, alarm)


def counted_connection() -> tuple[Connection, CountedCentral]:
    central = CountedCentral(accept_all)
    connection = Connection(central, Session(HELLO), clock=lambda: central.now)
    connection.open()
    central.received.clear()
    central.wakes = 0
    return connection, central


def test_serving_connection_wakes_only_for_packets() -> None:
    connection, central = counted_connection()
    for minute in range(10):
        central.deliver(Beat(), at=central.now + 30 * minute)
    connection.serve(lambda: central.now >= 100 + 270)
    assert central.wakes == 10
    assert not central.received


def test_serving_connection_asks_silent_central_periodically() -> None:
    connection, central = counted_connection()
    connection.serve(lambda: central.now >= 100 + 10 * IDLE)
    assert central.received == [Register(0, [], [])] * 9
    assert central.wakes <= 20  # for the answers, too


def test_waiting_connection_wakes_only_for_beats() -> None:
    connection, central = counted_connection()
    request = connection.request(Send(0, "stance"), wants_answer=True)
    for beat in range(50):
        central.deliver(Beat(), at=central.now + 2 * beat)
    assert not connection.wait(request, 99.0, "query")
    assert central.wakes <= 51
    assert not [header for header in central.received if isinstance(header, Register)]


@pytest.mark.parametrize("patience", [0.5, 2.0])
def test_impatient_wait_asks_before_central_counts_as_lost(patience: float) -> None:
    """The wait is shorter than the time between two heartbeats of central."""
    central = ScriptedCentral(accept_all)
    connection = Connection(central, Session(HELLO), clock=lambda: central.now, patience=patience)
    connection.open()
    request = connection.request(Send(0, "stance"), wants_answer=True)
    assert not connection.wait(request, 5.0, "query")


def test_idle_module_is_not_polled() -> None:
    with LocalCentral() as central, Module("legs", central).running() as legs:
        kept = legs._keep_alive
        assert kept is not None
        until(lambda: kept.due > time.monotonic() + 5.0, "nothing is due for a while")


def test_awaiting_coroutine_is_not_polled(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(coroutine_waits, "BRIEF", 0.2)
    with LocalCentral() as central, connect("user", central) as user:
        legs = Module("legs", central)

        @legs.handles(WALK)
        async def walk(task: Task) -> None:
            await task.query_send(UNHANDLED)

        with legs.running():
            user.command(WALK)
            (slot,) = legs._slots._slots

            def is_calm() -> bool:
                beat = slot._loop._timer if slot._loop is not None else None
                return beat is not None and beat.when() > time.monotonic() + 0.5

            until(is_calm, "the event loop no longer polls")


# --- Central --------------------------------------------------------------------------------------


@contextmanager
def welcomed_line(central: RealCentral) -> Iterator["zmq.Socket[bytes]"]:
    """Yield a module's line that central has welcomed."""
    with zmq.Context() as context, context.socket(zmq.DEALER) as line:
        line.linger = 0
        line.rcvtimeo = int(1000 * SOON)
        line.connect(central.address)
        send_header(line, Hello(1, headers.PROTOCOL_VERSION, "legs", str(id(line))))
        assert isinstance(receive_header(line), Welcome)
        yield line


def send_header(line: "zmq.Socket[bytes]", header: headers.ToCentral) -> None:
    line.send(codec.pack([(header, b"")]))


def receive_header(line: "zmq.Socket[bytes]") -> Any:
    ((header, _),) = codec.unpack_to_module(line.recv())
    return header


@pytest.fixture
def central(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[RealCentral]:
    monkeypatch.setattr(server, "BEAT_PERIOD", 0.05)
    with RealCentral(f"ipc://{tmp_path}/central.sock") as central:
        yield central


def test_central_beats_only_to_waiting_connections(central: RealCentral) -> None:
    with welcomed_line(central) as idle, welcomed_line(central) as waiting:
        send_header(waiting, Register(2, [WALK.format]))
        assert receive_header(waiting) == Accepted(2)
        send_header(waiting, Send(3, WALK.name))
        task = receive_header(waiting).id
        send_header(waiting, headers.AwaitPoint(4, Point(task, Moment.END_ACHIEVING)))
        assert [receive_header(waiting) for _ in range(3)] == [Beat()] * 3
        send_header(idle, Register(2, []))
        assert receive_header(idle) == Accepted(2)  # nothing came before it


def test_departure_is_silent_and_lost_module_is_detected(central: RealCentral) -> None:
    with welcomed_line(central) as idle:
        connect("user", central.address).close()
        until(lambda: central.server._closed == 2, "its line and its pulse have closed")
        send_header(idle, Register(2, []))
        assert receive_header(idle) == Accepted(2)
        with welcomed_line(central):
            pass
        assert receive_header(idle) == Beat()
        until(
            lambda: len(central.server.central.registry.connections) == 1,
            "central has lost the other module",
        )


def test_new_connection_is_asked_to_identify_itself(central: RealCentral) -> None:
    """A module whose central was killed learns at once that another central runs."""
    line = DealerTransport(central.address)
    until(
        lambda: line.receive(0.1) == codec.pack_item(Unknown()),
        "central answers the connection itself",
    )
    line.close()
