"""Raw bytes sent to a real central. Central keeps serving others, and its log stays readable."""

import json
import socket
import struct
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Annotated, Any

import msgpack
import msgspec
import numpy as np
import pytest
import zmq
from integration.commanded import tca as ask
from processes import Central, central, tca

from tca_central.events import AWAY
from tca_module import Client, Inform, MisuseError, connect
from tca_module.errors import BadData
from tca_tools.live.questions import attached, messages, modules, status, variables
from tca_wire.packets.codec import pack_item, unpack_to_module
from tca_wire.packets.headers import (
    PROTOCOL_VERSION,
    Ask,
    Hello,
    Kill,
    Refused,
    Register,
    Send,
    Unknown,
    Welcome,
)
from tca_wire.packets.parts import MessageFormat
from tca_wire.points import TaskId
from tca_wire.vocabulary import Limit, MessageClass, Refusal

pytestmark = pytest.mark.slow

SOON = 20_000  # milliseconds
ESCAPES = "\x1b]0;mine\x07\x1b[2J\ncentral: all is well\r\u202e"
_ZMTP = b"\xff\0\0\0\0\0\0\0\x01\x7f\x03\0NULL" + bytes(48)
_READY = b"\x04\x29\x05READY\x0bSocket-Type\0\0\0\x06DEALER\x08Identity\0\0\0\0"


@pytest.fixture(scope="module")
def daemon(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Central]:
    """Run one central for all tests. Each attack must leave the central unchanged."""
    with central(tmp_path_factory.mktemp("attacked"), bind="tcp://127.0.0.1:*") as running:
        running.address = running.first_line.rpartition(" ")[2]
        yield running
        assert running.process.poll() is None
        output = running.stop()
    for line in output.splitlines():
        assert line.isprintable()
        assert line.startswith("central: ")
        assert len(line) <= 2000
    assert "internal error" not in output


@pytest.fixture
def friend(daemon: Central) -> Iterator[Client]:
    """Connect a normal client, which checks central before and after each attack."""
    with connect("friend", daemon.address) as client:
        client.status()
        yield client
        client.status()
    assert daemon.process.poll() is None


class RawConnection:
    """A raw ZeroMQ connection without the module protocol."""

    def __init__(self, address: str, routing_id: bytes = b"") -> None:
        self.socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.DEALER)
        if routing_id:
            self.socket.setsockopt(zmq.ROUTING_ID, routing_id)
        self.socket.setsockopt(zmq.LINGER, 0)
        self.socket.connect(address)

    def ask(self, *frames: bytes) -> list[Any]:
        """Send frames. Return the headers of the reply."""
        self.socket.send_multipart(frames)
        assert self.socket.poll(SOON), "no answer"
        return [header for header, _ in unpack_to_module(self.socket.recv())]

    def hello(self) -> Any:
        (welcome,) = self.ask(pack_item(hello()))
        return welcome


def hello(**fields: Any) -> Hello:
    options: dict[str, Any] = {
        "version": PROTOCOL_VERSION,
        "module": "rogue",
        "incarnation": "run of rogue",
        **fields,
    }
    return Hello(1, **options)


@pytest.fixture
def rogue(daemon: Central, friend: Client) -> Iterator[RawConnection]:
    line = RawConnection(daemon.address)
    yield line
    line.socket.close()


@contextmanager
def raw_tcp(daemon: Central) -> Iterator[socket.socket]:
    """Open a raw TCP connection."""
    with socket.create_connection(
        ("127.0.0.1", int(daemon.address.rpartition(":")[2])), 20
    ) as line:
        yield line


def packet_item(header: bytes, body: bytes = b"") -> bytes:
    return struct.pack(">II", len(header), len(body)) + header + body


SEND = bytes([4])
BAD = {
    "nothing but lengths": struct.pack(">II", 0, 0),
    "lengths beyond": struct.pack(">II", 0xFFFFFFFF, 0xFFFFFFFF),
    "half a length": b"\0\0\0",
    "text": b"GET / HTTP/1.1\r\nHost: robot\r\n\r\n",
    "nesting": packet_item(b"\x91" * 100_000),
    "nesting in a field": packet_item(b"\x93\x04\x01" + b"\x91" * 5000 + b"\xc0"),
    "a map": packet_item(msgpack.packb({"kind": 4})),
    "an unknown kind": packet_item(msgpack.packb([250, 1])),
    "no integer": packet_item(msgpack.packb([4, "one", "move"])),
    "NaN where a number is": packet_item(msgpack.packb([4, float("nan"), "move"])),
    "an integer of 65 bits": packet_item(b"\x93\x04\xcf" + b"\xff" * 8 + b"\xa4move\x00"),
    "a lone surrogate": packet_item(b"\x93\x04\x01\xa3\xed\xa0\x80"),
    "bad UTF-8": packet_item(b"\x93\x04\x01\xa2\xff\xfe"),
    "more fields": packet_item(msgpack.packb([12, 1, 2, 3])),
    "too few": packet_item(msgpack.packb([4])),
    "a length that is none": packet_item(b"\xdd\xff\xff\xff\xff"),
    "an extension": packet_item(b"\xc7\xff\x01" + bytes(255)),
    "two items of which one is bad": pack_item(Ask(1, "status")) + b"\0\0\0\x01\0\0\0\0\xc1",
}


@pytest.mark.parametrize("what", BAD)
def test_malformed_packet_is_refused(rogue: RawConnection, what: str) -> None:
    (answer,) = rogue.ask(BAD[what])
    assert isinstance(answer, Refused | Unknown)
    if isinstance(answer, Refused):
        assert (answer.number, answer.refusal) == (0, Refusal.PROTOCOL)
        assert answer.text.isprintable()


@pytest.mark.parametrize("frames", [2, 100, 50_000])
def test_packet_of_several_frames_is_refused(rogue: RawConnection, frames: int) -> None:
    (answer,) = rogue.ask(pack_item(hello()), *[b""] * (frames - 1))
    assert answer.text == f"{frames:,} frames; a packet is one"
    assert isinstance(rogue.hello(), Welcome)


@pytest.mark.parametrize("version", [0, 4, PROTOCOL_VERSION + 1, (1 << 63) - 1, -1])
def test_other_protocol_version_is_refused_with_both_named(
    rogue: RawConnection, version: int
) -> None:
    (answer,) = rogue.ask(pack_item(hello(version=version)))
    assert f"speaks protocol {version}, central {PROTOCOL_VERSION}" in answer.text


def test_routing_id_reserved_by_central_is_shut_out(daemon: Central, friend: Client) -> None:
    line = RawConnection(daemon.address, AWAY + b"0")
    (answer,) = line.ask(pack_item(hello()))
    line.socket.close()
    assert answer.refusal is Refusal.SHUT_OUT


def test_hostile_names_cannot_steer_a_terminal(daemon: Central, rogue: RawConnection) -> None:
    for name in (ESCAPES, "../../../etc/passwd\n", "x" * 100_000):
        (answer,) = rogue.ask(pack_item(hello(module=name)))
        assert isinstance(answer, Refused)
    rogue.hello()
    formats = [
        MessageFormat("walk", MessageClass.GOAL, ESCAPES),
        MessageFormat("../walk", MessageClass.GOAL, "{}"),
    ]
    rogue.ask(pack_item(Register(2, formats)))
    sent = rogue.ask(pack_item(Send(3, "walk"), b"\xd9\xff" + ESCAPES.encode()))
    rogue.ask(pack_item(Send(4, ESCAPES * 1000)))
    for command in (status, modules, messages, variables, attached):
        code, output, errors = ask(command, "--central", daemon.address)
        assert code == 0, errors
        assert all(line.isprintable() for line in (output + errors).splitlines())
    rogue.ask(pack_item(Kill(5, TaskId(sent[-1].id), ESCAPES * 1000)))


def test_client_rejects_oversized_body_or_header_before_sending(friend: Client) -> None:
    note = Inform("note", np.ndarray)
    with pytest.raises(BadData, match=f"bytes: a message holds at most {Limit.LARGE:d}"):
        friend.inform(note, np.broadcast_to(np.uint8(0), Limit.LARGE + 1))
    with pytest.raises(MisuseError, match="the limit is 1,048,576"):
        friend.inform(Inform("told", Annotated[int, msgspec.Meta(description="x" * (1 << 20))]), 1)


def test_oversized_body_is_refused_with_both_sizes(rogue: RawConnection) -> None:
    rogue.hello()
    (answer,) = rogue.ask(pack_item(Send(99, "note"), bytes(Limit.BODY + 1)))
    assert (answer.number, answer.refusal) == (99, Refusal.PROTOCOL)
    assert "8,388,609" in answer.text
    assert "8,388,608" in answer.text


# --- below ZeroMQ ---------------------------------------------------------------------------------

STRANGERS = {
    "HTTP": b"GET / HTTP/1.1\r\nHost: robot\r\n\r\n",
    "TLS": b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + bytes(500),
    "SSH": b"SSH-2.0-OpenSSH_9.2\r\n",
    "another greeting": b"\xff" * 64,
    "ZMTP 1.0": b"\x01\x00\x05\x00hell",
    "a mechanism that is none": _ZMTP[:12] + b"ROT13" + bytes(47),
    "a frame of 2^62 bytes": _ZMTP + _READY + b"\x02\x40" + bytes(7),
    "a command of 2^62 bytes": _ZMTP + b"\x06\x40" + bytes(7),
    "a frame of 17 MiB": _ZMTP + _READY + b"\x02" + struct.pack(">Q", 17 << 20) + bytes(1000),
    "an endless READY": _ZMTP + b"\x06" + struct.pack(">Q", 1 << 20) + b"\x05READY" + bytes(1000),
}


@pytest.mark.parametrize("what", STRANGERS)
def test_foreign_protocol_does_not_disturb_central(
    daemon: Central, friend: Client, what: str
) -> None:
    with raw_tcp(daemon) as line:
        line.sendall(STRANGERS[what])
        line.settimeout(0.1)
        with suppress(
            ConnectionError, TimeoutError
        ):  # ZeroMQ may wait for more of a supposed ZMTP 1.0 greeting
            while line.recv(4096):
                pass
        friend.status()


def test_endless_message_does_not_disturb_other_clients(daemon: Central, friend: Client) -> None:
    with raw_tcp(daemon) as line:
        line.sendall(_ZMTP + _READY)
        for _ in range(16):
            line.sendall(
                b"\x03" + struct.pack(">Q", 1 << 20) + bytes(1 << 20)
            )  # with the MORE flag
        friend.status()


def test_half_open_connections_are_closed(daemon: Central, friend: Client) -> None:
    files = Path(f"/proc/{daemon.process.pid}/fd")
    before = len(list(files.iterdir()))
    with ExitStack() as lines:
        for _ in range(200):
            lines.enter_context(raw_tcp(daemon))
        friend.status()
        assert len(list(files.iterdir())) > before + 100
        end = time.monotonic() + 20
        while len(list(files.iterdir())) > before + 20 and time.monotonic() < end:
            time.sleep(0.05)
        assert len(list(files.iterdir())) <= before + 20


def test_journal_after_attacks_is_readable_and_printable(daemon: Central, friend: Client) -> None:
    """Everything that ``tca log show`` prints is printable, too."""
    output = tca("log", "show", str(daemon.journal), "--json")
    assert all(json.loads(line) for line in output.stdout.splitlines())
    shown = tca("log", "show", str(daemon.journal))
    assert shown.returncode == 0
    assert all(line.isprintable() for line in (shown.stdout + shown.stderr).splitlines())
