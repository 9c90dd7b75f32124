"""The configuration of the log's servers on a page starts three servers that hold a log."""

import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from docs.pages import ROOT
from nats_servers import SERVER, free_port

from tca_central.replication.jetstream import JetStreamLog
from tca_central.replication.shared_log import Kind

CONFIGURATION = (ROOT / "examples/robot/nats.conf").read_text()


@pytest.fixture
def ports(tmp_path: Path) -> Iterator[list[int]]:
    """The ports of three servers, which differ as the page says."""
    ports, routes = [free_port() for _ in range(3)], [free_port() for _ in range(3)]
    processes = []
    for number in range(3):
        text = CONFIGURATION.replace("robot-1", f"robot-{number + 1}").replace(
            "max_file_store: 10G", "max_file_store: 100M"
        )
        text = text.replace('listen: "10.0.0.1:4222"', f'listen: "127.0.0.1:{ports[number]}"')
        text = text.replace('listen: "10.0.0.1:6222"', f'listen: "127.0.0.1:{routes[number]}"')
        for machine in range(3):
            text = text.replace(f"10.0.0.{machine + 1}:6222", f"127.0.0.1:{routes[machine]}")
        folder = tmp_path / str(number)
        folder.mkdir()
        (folder / "nats.conf").write_text(text)
        command = [str(SERVER), "-c", "nats.conf", "-l", "server.log"]
        processes.append(subprocess.Popen(command, cwd=folder))
    yield ports
    for process in processes:
        process.kill()
        process.wait()


@pytest.mark.slow
def test_servers_of_the_page_hold_a_log(ports: list[int]) -> None:
    servers = [f"nats://robot:change-me@127.0.0.1:{port}" for port in ports]
    log = JetStreamLog(servers, "rover")
    try:
        number = log.append(Kind.TURN, [b"input"], 0)
        assert log.read(0, 5.0)[-1].sequence == number
    finally:
        log.close()


def test_differing_lines_are_those_of_the_remark() -> None:
    differing = [n for n, line in enumerate(CONFIGURATION.splitlines(), 1) if "robot-1" in line]
    differing += [
        n for n, line in enumerate(CONFIGURATION.splitlines(), 1) if 'listen: "10.0.0.1' in line
    ]
    assert differing == [2, 3, 5]
