"""Who sends more than central reads, and dies, does not take central with it; and a line that takes nothing is noticed."""

import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from module.real_central import RealCentral

from tca_module import connect

pytestmark = pytest.mark.slow

FLOOD = """
import os, signal, sys, zmq
to_central = zmq.Context().socket(zmq.DEALER)
to_central.connect(sys.argv[1])
while to_central.poll(300, zmq.POLLOUT):  # until nothing more is taken
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


def test_a_module_that_floods_a_busy_central_and_is_killed(tmp_path: Path) -> None:
    """The queue of the dead was full, so ZeroMQ had stopped to read, and aborted the process at its next heartbeat."""
    command = [sys.executable, "-c", CENTRAL, f"ipc://{tmp_path}/central.sock", FLOOD]
    lived = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (lived.returncode, lived.stdout) == (0, f"{-signal.SIGKILL}\n"), lived.stderr


def test_a_line_that_takes_nothing_for_five_seconds_is_dead() -> None:
    """The kernel asks every second, so it can tell; this is what it was told."""
    with RealCentral("tcp://127.0.0.1:*") as central, connect("user", central.address):
        assert (5000, 1, 1) in patience_of_lines_at(int(central.address.rpartition(":")[2]))


def patience_of_lines_at(port: int) -> list[tuple[int, ...]]:
    """Of the TCP sockets of this process that stand at a port: milliseconds; and seconds until, and between, probes."""
    options = socket.TCP_USER_TIMEOUT, socket.TCP_KEEPIDLE, socket.TCP_KEEPINTVL
    found = []
    for file in Path("/proc/self/fd").iterdir():
        if not file.is_socket():
            continue
        with socket.socket(fileno=os.dup(int(file.name))) as line:
            is_there = line.family == socket.AF_INET and line.getsockname()[1] == port
            if is_there and line.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE):
                found.append(tuple(line.getsockopt(socket.IPPROTO_TCP, option) for option in options))
    return found
