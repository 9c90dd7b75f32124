"""Programs that want more of central than there is: real processes and a small budget."""

import os
import signal
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
import zmq
from integration.programs import Central, central, program

from tca_module import Inform, Query, Refused, Variable, connect
from tca_wire.packets.codec import pack, pack_item
from tca_wire.packets.headers import PROTOCOL_VERSION, GetVariable, Hello

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
