"""Too many connections. Central rejects newcomers in time, logs each rejection, and keeps on."""

import resource
import socket
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
import zmq
from processes import Central, central

from tca_module import CentralLost, connect
from tca_module.sockets.place import rejects_connections

pytestmark = pytest.mark.slow

LIMITED = """
import resource, sys
resource.setrlimit(resource.RLIMIT_NOFILE, ({soft}, {hard}))
from tca_central.__main__ import central
central()
"""


def limited_central(soft: int, hard: int) -> list[str]:
    return [sys.executable, "-c", LIMITED.format(soft=soft, hard=hard)]


@pytest.fixture(autouse=True)
def _raise_file_limit() -> Iterator[None]:
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (before[1], before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_NOFILE, before)


def test_central_survives_running_out_of_file_descriptors(tmp_path: Path) -> None:
    with central(tmp_path, command=limited_central(1024, 1024)) as daemon, ExitStack() as stack:
        for _ in range(1100):
            stack.enter_context(socket.socket(socket.AF_UNIX)).connect(
                daemon.address.removeprefix("ipc://")
            )
        line = wait_for_log(daemon, "accepts no more connections")
        assert "of 1024 file descriptors are in use" in line
        stack.close()
        wait_for_log(daemon, "accepts connections again")
        connect("late", daemon.address).close()


@pytest.mark.parametrize("bind", ["", "tcp://127.0.0.1:*"])
def test_full_central_rejects_newcomers_and_serves_connected(bind: str, tmp_path: Path) -> None:
    with central(tmp_path, bind=bind, command=limited_central(100, 100)) as daemon:
        address = daemon.first_line.rpartition(" ")[2]
        with connect("early", address) as early, zmq.Context() as context:
            idle = idle_connections(context, address)
            wait_for_log(daemon, "accepts no more connections")
            assert rejects_connections(address)
            with pytest.raises(
                CentralLost, match="it takes no more connections: end some programs, or start it"
            ):
                connect("late", address, patience=0.5)
            assert early.status()["connections"] == 1
            for one in idle:
                one.close(linger=0)
            wait_for_log(daemon, "accepts connections again")
            assert not rejects_connections(address)
            connect("later", address).close()


def test_central_raises_its_descriptor_limit_to_the_maximum(tmp_path: Path) -> None:
    with central(tmp_path, command=limited_central(300, 600)) as daemon:
        limits = resource.prlimit(daemon.process.pid, resource.RLIMIT_NOFILE)
    assert limits == (600, 600)


def test_full_central_stops_cleanly(tmp_path: Path) -> None:
    with central(tmp_path, command=limited_central(100, 100)) as daemon, zmq.Context() as context:
        idle = idle_connections(context, daemon.address)
        wait_for_log(daemon, "accepts no more connections")
        daemon.stop()
        assert daemon.process.returncode == 0
        for one in idle:
            one.close(linger=0)


def idle_connections(
    context: "zmq.Context[zmq.Socket[bytes]]", address: str
) -> "list[zmq.Socket[bytes]]":
    idle = [context.socket(zmq.DEALER) for _ in range(60)]
    for one in idle:
        one.connect(address)
    return idle


def wait_for_log(daemon: Central, words: str) -> str:
    """Wait for a log line that contains *words*."""
    while words not in (line := daemon.process.stderr.readline()):
        assert line, f"central ended without logging: {words}"
    return line
