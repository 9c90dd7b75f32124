"""Large data with a real central, whose modules speak the protocol themselves."""

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import pytest
import zmq
from processes import Central, central
from waiting import SOON, wait_until

from tca_wire.packets.codec import pack_item, unpack_to_module
from tca_wire.packets.headers import (
    PROTOCOL_VERSION,
    Accepted,
    Answer,
    Bye,
    Deliver,
    EndCentral,
    Hello,
    Receipt,
    Refused,
    Register,
    Reply,
    Send,
    UsesStore,
    Welcome,
)
from tca_wire.packets.large import Handle, Keep, pack_handle
from tca_wire.packets.parts import HandlerFormat, MessageFormat
from tca_wire.packets.resources import GetVariable, SetVariable
from tca_wire.vocabulary import MessageClass, Refusal

pytestmark = pytest.mark.slow

DATA = os.urandom(1 << 20)
T = TypeVar("T")


class RawModule:
    """A module that handles its own messages, one at a time, over a socket."""

    def __init__(self, address: str, name: str, *, shares: bool = True) -> None:
        self.name, self.shares = name, shares
        self.socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.DEALER)
        self.socket.setsockopt(zmq.LINGER, 0)
        self.socket.connect(address)
        self.others: list[tuple[Any, bytes]] = []
        self.number = 0
        self.join()
        picture = MessageFormat("picture", MessageClass.INFORM, "{}")
        look = MessageFormat("look", MessageClass.QUERY, "{}", "{}")
        grasp = MessageFormat("grasp", MessageClass.COMMAND, "{}", "{}")
        variable = MessageFormat("map", MessageClass.VARIABLE, "{}")
        handled = [HandlerFormat(one, name) for one in ("picture", "look", "grasp")]
        self.send(Register(self.next(), [picture, look, grasp, variable], handled))
        self.receive(Accepted)

    def join(self) -> None:
        """Introduce this module, for the first time or again."""
        pid = f"raw:{os.getpid()}"
        self.send(Hello(1, PROTOCOL_VERSION, self.name, self.name, resource=self.name, process=pid))
        self.number = max(self.number, 1)
        welcome, _ = self.receive(Welcome)
        self.store = Path(welcome.store)
        if self.shares:
            assert (self.store / "key").read_text() == welcome.epoch
            self.send(UsesStore())

    def next(self) -> int:
        self.number += 1
        return self.number

    def send(self, header: Any, body: bytes = b"") -> None:
        self.socket.send(pack_item(header, body))

    def receive(self, kind: type[T]) -> tuple[T, bytes]:
        """Return the next header of a kind, with its body."""
        while True:
            for place, (header, body) in enumerate(self.others):
                if isinstance(header, kind):
                    del self.others[place]
                    return header, body
            assert self.socket.poll(int(SOON * 1000)), f"no {kind.__name__}"
            packet = self.socket.recv()
            self.others += unpack_to_module(packet)
            self.send(Receipt(len(packet)))

    def write(self, number: int, data: bytes = DATA, keep: int = 0) -> bytes:
        """Write a segment. Return the body of its message."""
        path = self.store / self.name / f"{number}.new"
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(data)
        return pack_handle(Handle(f"{self.name}/{number}", len(data), keep, b"\xc0"))

    def files(self) -> list[str]:
        return sorted(path.name for path in (self.store / self.name).iterdir())

    def close(self) -> None:
        self.socket.close()


@contextmanager
def modules(running: Central, *names: str) -> Iterator[list[RawModule]]:
    opened = [RawModule(running.address, name) for name in names]
    try:
        yield opened
    finally:
        for one in opened:
            one.close()


def test_segment_is_held_until_it_is_handled(tmp_path: Path) -> None:
    with central(tmp_path) as running, modules(running, "e1") as (eyes,):
        body = eyes.write(1)
        eyes.send(Send(eyes.next(), "picture"), body)
        eyes.receive(Accepted)
        delivered, received = eyes.receive(Deliver)
        assert received == body
        assert eyes.files() == ["1"]
        eyes.send(Reply(delivered.delivery), b"\xc0")
        wait_until(lambda: eyes.files() == ["1.free"])
        running.stop()
        assert not eyes.store.exists()


def test_restarted_central_still_holds_segments(tmp_path: Path) -> None:
    with central(tmp_path) as running, modules(running, "e2") as (eyes,):
        for number in (1, 2, 3):
            eyes.send(Send(eyes.next(), "picture"), eyes.write(number))
            eyes.receive(Accepted)
        first, _ = eyes.receive(Deliver)
        running.kill()
        assert eyes.files() == ["1", "2", "3"]
        with central(tmp_path, bind=running.address) as again:
            eyes.others.clear()
            eyes.join()
            first, _ = eyes.receive(Deliver)
            eyes.send(Reply(first.delivery), b"\xc0")
            wait_until(lambda: eyes.files() == ["1.free", "2", "3"])
            for number in (2, 3):
                delivered, body = eyes.receive(Deliver)
                assert body == pack_handle(Handle(f"e2/{number}", len(DATA), 0, b"\xc0"))
                eyes.send(Reply(delivered.delivery), b"\xc0")
            wait_until(lambda: eyes.files() == ["1.free", "2.free", "3.free"])
            again.stop()
        assert not eyes.store.exists()


def test_start_of_central_removes_what_is_left(tmp_path: Path) -> None:
    for name in ("killed", "next"):
        (tmp_path / name).mkdir()
    with central(tmp_path / "killed") as running, modules(running, "e3") as (eyes,):
        eyes.send(Send(eyes.next(), "picture"), eyes.write(1))
        eyes.receive(Accepted)
        running.kill()
    assert eyes.files() == ["1"]
    with central(tmp_path / "next"):
        wait_until(lambda: not eyes.store.exists())


def test_kept_variable_survives_another_central(tmp_path: Path) -> None:
    with central(tmp_path / "kept") as running, modules(running, "e8") as (eyes,):
        body = eyes.write(1, keep=Keep.TASK)
        eyes.send(SetVariable(eyes.next(), "map"), body)
        eyes.receive(Accepted)
        eyes.send(EndCentral(eyes.next(), keep=True))
        running.process.wait()
        with central(tmp_path / "other"):
            wait_until(lambda: not eyes.store.exists())
        with central(tmp_path / "kept", bind=running.address):
            eyes.others.clear()
            eyes.join()
            eyes.send(GetVariable(eyes.next(), "map"))
            assert eyes.receive(Answer)[1] == body
            assert (eyes.store / "e8" / "1").read_bytes() == DATA


def test_files_go_when_their_module_has_left(tmp_path: Path) -> None:
    with central(tmp_path) as running, modules(running, "e4") as (eyes,):
        for number in (1, 2):
            eyes.send(Send(eyes.next(), "picture"), eyes.write(number))
            eyes.receive(Accepted)
        eyes.write(3)
        eyes.send(Bye())
        wait_until(lambda: eyes.files() == ["1", "2"])
        with modules(running, "f4") as (other,):
            for _ in range(2):
                delivered, _ = other.receive(Deliver)
                other.send(Reply(delivered.delivery), b"\xc0")
            wait_until(lambda: not (other.store / "e4").exists())


def test_inline_bytes_pass_through_central(tmp_path: Path) -> None:
    inline = pack_handle(Handle("", len(DATA), 0, b"\xc0")) + DATA
    with central(tmp_path) as running:
        far = RawModule(running.address, "f5", shares=False)
        far.send(Send(far.next(), "look"), inline)
        delivered, body = far.receive(Deliver)
        assert body == inline
        assert [path.stat().st_size for path in (far.store / "0").iterdir()] == [len(DATA)]
        far.send(Reply(delivered.delivery), inline)
        _, body = far.receive(Answer)
        assert body == inline
        far.send(Bye())
        wait_until(lambda: not list((far.store / "0").iterdir()))
        far.close()


def test_full_memory_refuses_large_data(tmp_path: Path) -> None:
    with central(tmp_path, "--memory", "16M") as running, modules(running, "e6") as (eyes,):
        for number in range(1, 10):
            eyes.send(Send(eyes.next(), "picture"), eyes.write(number))
            if number < 8:
                eyes.receive(Accepted)
        refused, _ = eyes.receive(Refused)
        assert refused.refusal is Refusal.OVERLOAD
        wait_until(lambda: "8.free" in eyes.files())
        assert eyes.files()[:7] == [str(number) for number in range(1, 8)]


@pytest.mark.parametrize("sync", ["always", "batch"])
def test_data_of_tasks_survive_a_lost_memory(tmp_path: Path, sync: str) -> None:
    with central(tmp_path, "--sync", sync) as running, modules(running, "e7") as (eyes,):
        body = eyes.write(1, keep=Keep.TASK)
        eyes.send(Send(eyes.next(), "grasp"), body)
        eyes.receive(Accepted)
        copies = running.journal / "held"
        wait_until(lambda: [one for one in copies.rglob("*") if one.name == "1"])
        running.kill()
        (eyes.store / "e7" / "1").unlink()
        with central(tmp_path, bind=running.address) as again:
            eyes.others.clear()
            eyes.join()
            delivered, received = eyes.receive(Deliver)
            assert received == body
            assert (eyes.store / "e7" / "1").read_bytes() == DATA
            eyes.send(Reply(delivered.delivery), b"\xc0")
            wait_until(lambda: not [one for one in copies.rglob("*") if one.is_file()])
            again.signal(signal.SIGTERM)
            again.stop()
