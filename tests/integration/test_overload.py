"""Programs that want more of central than there is: real processes and a small budget."""

import os
import queue
import signal
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
import zmq
from integration.programs import Central, central, program

from tca_central.core import Central as Core
from tca_central.shell import server as shell
from tca_central.shell.gate import OpenGate
from tca_central.shell.server import Daemon
from tca_module import Condition, Inform, Module, Query, Refused, Variable, connect
from tca_wire.packets.codec import pack, pack_item, unpack_to_module
from tca_wire.packets.headers import PROTOCOL_VERSION, Ask, Bye, GetVariable, Hello, Register, Send
from tca_wire.packets.parts import MessageFormat
from tca_wire.vocabulary import MessageClass

pytestmark = pytest.mark.slow

NOTE, LOOK, MAP = Inform("note", bytes), Query("look", bytes, reply=int), Variable("map", bytes)
EYES = """
    from tca_module import Inform, Module, Query
    eyes = Module("eyes")
    eyes.handles(Inform("note", bytes))(lambda task, data: None)
    eyes.handles(Query("look", bytes, reply=int))(lambda task, data: len(data))
    eyes.after(0.0, lambda _: print("runs", flush=True))
    eyes.run()
"""
MOST = 120 << 20
"""Bytes of central's process, of which 40 MiB are Python and its libraries; 400 MiB are asked for."""


@pytest.fixture
def daemon(tmp_path: Path) -> Iterator[Central]:
    with central(tmp_path, "--memory", "32M", "--lost-after", "0", "--no-inputs") as daemon:
        yield daemon


def peak(daemon: Central) -> int:
    """The most that a process has had of the machine's memory."""
    lines = Path(f"/proc/{daemon.process.pid}/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith("VmHWM")).split()[1]) << 10


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="counts as Linux does")
def test_a_receiver_that_stands_still_costs_only_what_is_meant_for_it(daemon: Central) -> None:
    with program(EYES, daemon.address) as eyes, connect("user", daemon.address) as user:
        assert eyes.stdout
        assert eyes.stdout.readline() == "runs\n"
        eyes.send_signal(signal.SIGSTOP)
        data = os.urandom(1 << 20)
        for _ in range(100):
            user.inform(NOTE, data)
        with pytest.raises(Refused, match="messages and tasks hold"):
            user.query(LOOK, data)
        dropped = user.status()["dropped"]
        assert dropped >= 80
        assert user.status("load")["overloads"] == dropped + 1
        eyes.send_signal(signal.SIGCONT)
        assert user.query(LOOK, b"x", timeout=20.0) == 1
        assert user.status("load")["memory"]["messages and tasks"][0] < 1 << 20
    assert peak(daemon) < MOST


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="counts as Linux does")
def test_who_asks_and_reads_nothing_costs_the_others_nothing(daemon: Central) -> None:
    with connect("user", daemon.address) as user, ExitStack() as lines:
        user.set_variable(MAP, bytes(1 << 20))
        for number in range(10):
            line: zmq.Socket[bytes] = lines.enter_context(zmq.Context.instance().socket(zmq.DEALER))
            line.setsockopt(zmq.LINGER, 0)
            line.setsockopt(zmq.RCVHWM, 1)
            line.connect(daemon.address)
            line.send(pack_item(Hello(1, PROTOCOL_VERSION, "deaf", f"run {number}")))
            line.send(pack([(GetVariable(2 + one, "map"), b"") for one in range(40)]))
        for _ in range(20):
            assert len(user.get_variable(MAP)) == 1 << 20  # and is heard each time
    assert peak(daemon) < MOST


def test_ten_thousand_names_that_nobody_handles_do_not_keep_others_out(tmp_path: Path) -> None:
    """The names of informs that wait are given up when who declared them has left; what is dropped is counted."""
    line: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.DEALER)
    with central(tmp_path, "--no-inputs") as daemon, line:
        line.connect(daemon.address)
        line.send(pack_item(Hello(1, PROTOCOL_VERSION, "flood", "a run")))
        for first in range(0, 10_000, 500):
            names = [f"name{first + one}" for one in range(500)]
            declared = [MessageFormat(name, MessageClass.INFORM, "") for name in names]
            line.send(pack_item(Register(first + 2, declared)))
            line.send(pack([(Send(0, name), b"") for name in names]))
        line.send(pack_item(Ask(10_002, "status")))
        while not any(getattr(header, "number", 0) == 10_002 for header, _ in unpack_to_module(line.recv())):
            pass
        line.send(pack_item(Bye()))
        with connect("watcher", daemon.address) as watcher:
            while watcher.status()["modules"] > 1:
                pass
            assert watcher.status()["messages"] == watcher.status()["waiting for a handler"] == 10_000
            with program(EYES, daemon.address) as eyes:
                assert eyes.stdout
                assert eyes.stdout.readline() == "runs\n"
                assert watcher.query(LOOK, b"x", timeout=20.0) == 1
                dropped = watcher.status()["dropped"]
                assert dropped
                assert watcher.status("load")["overloads"] == dropped
                assert watcher.status()["waiting for a handler"] == 10_000 - dropped


@pytest.fixture
def turns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Daemon]:
    """A central whose turns the test takes itself, and to which lines within the process lead."""
    monkeypatch.setattr(shell, "BYTES_PER_TURN", 1000)
    server = Daemon(Core("epoch"), f"ipc://{tmp_path}/c.sock", gate=OpenGate())
    server.socket.bind("inproc://turns")
    yield server
    server.close()


def line_to(server: Daemon, name: str) -> "zmq.Socket[bytes]":
    line = server._context.socket(zmq.DEALER)
    line.setsockopt(zmq.LINGER, 0)
    line.setsockopt(zmq.SNDHWM, 0)
    line.connect("inproc://turns")
    line.send(pack_item(Hello(1, PROTOCOL_VERSION, name, f"run of {name}")))
    return line


def test_nobody_waits_behind_what_another_has_sent_in_big_packets(turns: Daemon) -> None:
    """ZeroMQ looks for lines on which something new has come only each hundred frames, unless it is asked."""
    with line_to(turns, "flood") as flood, line_to(turns, "user") as user:
        for _ in range(100):
            flood.send(pack_item(Send(0, "nothing"), bytes(2000)))
        while not user.poll(0):
            turns._receive()
            turns._flush()
        user.recv()
        for _ in range(3):  # now ZeroMQ knows that nothing more has come from there
            turns._receive()
        user.send(pack_item(Ask(2, "status")))
        for _ in range(3):
            turns._receive()  # a turn that takes in a big packet has answered those before
        assert user.poll(0)
        assert flood.poll(0)
        assert turns._has_arrived(), "the flood had ended"


def test_nobody_waits_while_central_hears_the_last_words_of_those_who_go(turns: Daemon) -> None:
    with line_to(turns, "user") as user:
        turns._hear_last_words()
        assert user.poll(0)


def test_a_circle_of_listeners_ends_with_an_error(tmp_path: Path) -> None:
    move, check = Query("move", int, reply=int), Inform("check", int)
    errors: queue.Queue[str] = queue.Queue()

    def again(task: Any, to: int) -> None:
        try:
            task.query(move, to)
        except Refused as refused:
            errors.put(refused.text)

    with central(tmp_path, "--tap-depth", "2") as daemon:
        robot = Module("robot", central=daemon.address)
        robot.handles(check)(again)
        robot.handles(move, resource="legs")(lambda _, to: to)
        with robot.running(), connect("user", daemon.address) as user:
            user.tap(Condition.AFTER_HANDLED, move, check)
            user.query(move, 1)
            assert "--tap-depth" in errors.get(timeout=30)
