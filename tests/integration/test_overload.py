"""Overload: real processes and a small memory budget."""

import os
import queue
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
import zmq
from module.real_central import RealCentral
from processes import Central, central, program

from tca_central.core import Central as Core
from tca_central.shell import server as shell
from tca_central.shell.gate import OpenGate
from tca_central.shell.server import Daemon
from tca_module import (
    CentralLost,
    Client,
    Command,
    Condition,
    Goal,
    Inform,
    Module,
    Outcome,
    Query,
    Refused,
    SentTask,
    Variable,
    connect,
)
from tca_wire.constraints import Flags
from tca_wire.journal import facts
from tca_wire.packets import headers
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
MEMORY_LIMIT = 120 << 20
"""The bytes that central's process may use. Python and its libraries take 40 MiB; the clients ask
for 400 MiB.
"""


@pytest.fixture
def daemon(tmp_path: Path) -> Iterator[Central]:
    with central(tmp_path, "--memory", "32M", "--lost-after", "0", "--no-inputs") as daemon:
        yield daemon


def peak(daemon: Central) -> int:
    """Return the peak memory of central's process."""
    lines = Path(f"/proc/{daemon.process.pid}/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith("VmHWM")).split()[1]) << 10


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="counts as Linux does")
def test_stopped_receiver_loses_only_its_own_messages(daemon: Central) -> None:
    with program(EYES, daemon.address) as eyes, connect("user", daemon.address) as user:
        eyes.hear("runs")
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
    assert peak(daemon) < MEMORY_LIMIT


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="counts as Linux does")
def test_client_that_reads_no_replies_does_not_slow_others(daemon: Central) -> None:
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
            assert len(user.get_variable(MAP)) == 1 << 20  # and is answered each time
    assert peak(daemon) < MEMORY_LIMIT


def test_unhandled_message_names_make_room_for_new_ones(tmp_path: Path) -> None:
    """Central forgets the names of waiting informs once the module that declared them has left.
    Dropped messages are counted.
    """
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
        while not any(
            getattr(header, "number", 0) == 10_002 for header, _ in unpack_to_module(line.recv())
        ):
            pass
        line.send(pack_item(Bye()))
        with connect("watcher", daemon.address) as watcher:
            while watcher.status()["modules"] > 1:
                pass
            assert (
                watcher.status()["messages"] == watcher.status()["waiting for a handler"] == 10_000
            )
            with program(EYES, daemon.address) as eyes:
                eyes.hear("runs")
                assert watcher.query(LOOK, b"x", timeout=20.0) == 1
                dropped = watcher.status()["dropped"]
                assert dropped
                assert watcher.status("load")["overloads"] == dropped
                assert watcher.status()["waiting for a handler"] == 10_000 - dropped


@pytest.fixture
def stepped_daemon(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Daemon]:
    """Yield a central whose turns the test takes itself, with in-process connections."""
    monkeypatch.setattr(shell, "BYTES_PER_TURN", 1000)
    server = Daemon(Core("epoch"), f"ipc://{tmp_path}/c.sock", gate=OpenGate())
    server.socket.bind("inproc://turns")
    yield server
    server.close()


def connect_raw(server: Daemon, name: str) -> "zmq.Socket[bytes]":
    line = server._context.socket(zmq.DEALER)
    line.setsockopt(zmq.LINGER, 0)
    line.setsockopt(zmq.SNDHWM, 0)
    line.connect("inproc://turns")
    line.send(pack_item(Hello(1, PROTOCOL_VERSION, name, f"run of {name}")))
    return line


def test_big_packets_of_one_client_do_not_delay_others(stepped_daemon: Daemon) -> None:
    """ZeroMQ polls idle connections for new input only every hundred frames, unless it is asked."""
    with connect_raw(stepped_daemon, "flood") as flood, connect_raw(stepped_daemon, "user") as user:
        for _ in range(100):
            flood.send(pack_item(Send(0, "nothing"), bytes(2000)))
        while not user.poll(0):
            stepped_daemon._receive()
            stepped_daemon._flush()
        user.recv()
        for _ in range(3):  # now ZeroMQ considers that connection idle
            stepped_daemon._receive()
        user.send(pack_item(Ask(2, "status")))
        for _ in range(3):
            stepped_daemon._receive()  # a turn with a big packet answers earlier requests
        assert user.poll(0)
        assert flood.poll(0)
        assert stepped_daemon._has_arrived(), "the flood had ended"


def test_central_answers_while_it_drains_goodbyes(stepped_daemon: Daemon) -> None:
    with connect_raw(stepped_daemon, "user") as user:
        stepped_daemon._drain()
        assert user.poll(0)


def test_listener_cycle_is_refused_at_tap_depth(tmp_path: Path) -> None:
    move, check = Query("move", int, reply=int), Inform("check", int)
    errors: queue.Queue[str] = queue.Queue()

    def query_again(task: Any, to: int) -> None:
        try:
            task.query(move, to)
        except Refused as refused:
            errors.put(refused.text)

    with central(tmp_path, "--tap-depth", "2") as daemon:
        robot = Module("robot", central=daemon.address)
        robot.handles(check)(query_again)
        robot.handles(move, resource="legs")(lambda _, to: to)
        with robot.running(), connect("user", daemon.address) as user:
            user.tap(Condition.AFTER_HANDLED, move, check)
            user.query(move, 1)
            assert "--tap-depth" in errors.get(timeout=30)


# --- dead connections ------------------------------------------------------------------------------


FLOOD = """
import os, signal, sys, zmq
to_central = zmq.Context().socket(zmq.DEALER)
to_central.connect(sys.argv[1])
while to_central.poll(300, zmq.POLLOUT):  # until its queue is full
    to_central.send(bytes(1000))
os.kill(os.getpid(), signal.SIGKILL)
"""
CENTRAL = """
import subprocess, sys, time
from tca_central.core import Central
from tca_central.shell.server import Daemon
server = Daemon(Central("run"), sys.argv[1])
flood = subprocess.run([sys.executable, "-c", sys.argv[2], server.endpoint])
time.sleep(1.2)  # a slow disk, say: ZeroMQ's heartbeats came every second
server.stop("all is read")
server.serve()
server.close()
print(flood.returncode)
"""


def test_central_survives_a_killed_flooding_client(tmp_path: Path) -> None:
    """The client's queue was full, so ZeroMQ had stopped reading. At its next heartbeat, ZeroMQ
    aborted the process.
    """
    command = [sys.executable, "-c", CENTRAL, f"ipc://{tmp_path}/central.sock", FLOOD]
    result = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (result.returncode, result.stdout) == (0, f"{-signal.SIGKILL}\n"), result.stderr


def test_tcp_connection_times_out_after_five_seconds() -> None:
    """The kernel probes every second. This test checks the options that the kernel received."""
    with RealCentral("tcp://127.0.0.1:*") as central, connect("user", central.address):
        assert (5000, 1, 1) in socket_timeouts_at(int(central.address.rpartition(":")[2]))


def socket_timeouts_at(port: int) -> list[tuple[int, ...]]:
    """Return options of this process's TCP sockets on a port: the timeout in ms, and the seconds
    until and between probes.
    """
    options = socket.TCP_USER_TIMEOUT, socket.TCP_KEEPIDLE, socket.TCP_KEEPINTVL
    found = []
    for file in Path("/proc/self/fd").iterdir():
        if not file.is_socket():
            continue
        with socket.socket(fileno=os.dup(int(file.name))) as line:
            is_there = line.family == socket.AF_INET and line.getsockname()[1] == port
            if is_there and line.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE):
                found.append(
                    tuple(line.getsockopt(socket.IPPROTO_TCP, option) for option in options)
                )
    return found


# --- one very long event --------------------------------------------------------------------------


WALK, STEP = Goal("walk"), Command("step")
DIG, DEPTH = Command("dig", result=int), Query("depth", reply=int)

DIGGER = """
    from tca_module import *
    digger, gauge = Module("digger"), Module("gauge")
    @gauge.handles(Query("depth", reply=int))
    def depth(task: Task) -> int:
        return 7
    @digger.handles(Command("dig", result=int))
    def dig(task: Task) -> int:
        print("digging", flush=True)
        while not task.cancelled:
            pass
        return 0
    with gauge.running(), digger.running():
        print("ready", flush=True)
        import signal; signal.pause()
"""

TASKS = 2_000


@pytest.mark.soak
def test_kill_of_very_large_tree_loses_no_module(tmp_path: Path) -> None:
    """Central is busy, and here also stopped, as on a slow machine.

    A client without patience gets CentralLost. Handlers continue, and no module is lost.
    """
    with central(tmp_path) as daemon, program(DIGGER, daemon.address) as digger:
        digger.hear("ready")
        with (
            connect("user", daemon.address, patience=120) as user,
            connect("hasty", daemon.address, patience=0.3) as hasty,
        ):
            dig, walk = user.command(DIG), user.goal(WALK)
            digger.hear("digging")
            fill_tree(user, walk)
            assert user.query(DEPTH, timeout=60) == 7
            daemon.signal(signal.SIGSTOP)
            with pytest.raises(CentralLost):
                hasty.query(DEPTH)
            daemon.signal(signal.SIGCONT)
            assert walk.kill()
            assert walk.wait(timeout=60) is Outcome.KILLED
            assert user.query(DEPTH, timeout=60) == 7
            assert {"digger", "gauge", "hasty"} <= {module.name for module in user.modules()}
            assert dig.kill()
            assert dig.wait(timeout=60) is Outcome.KILLED
    assert len(daemon.facts(facts.Killed)) == TASKS + 2
    assert not daemon.facts(facts.Failed)


def fill_tree(user: Client, walk: SentTask[None]) -> None:
    """Send commands as ``command`` does, but wait for none of them."""
    connection = user._connection()
    connection.declare(STEP)
    for _ in range(TASKS):
        connection.request(
            headers.Send(0, STEP.name, parent=walk.id, flags=Flags.NONE), STEP.encode_data(None)
        )
