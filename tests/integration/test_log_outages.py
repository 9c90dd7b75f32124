"""A replicated log on three servers: outages lose nothing, and a standby starts no run."""

import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from module.real_central import until
from nats_servers import NatsServers

from tca_central.replication import member as members
from tca_central.replication.jetstream import JetStreamLog
from tca_central.replication.member import Member
from tca_central.replication.records import encode
from tca_central.replication.shared_log import Kind, log_in
from tca_central.shell.input_log import Ended
from tca_central.shell.store import Store


@pytest.fixture
def one_server(tmp_path: Path) -> Iterator[NatsServers]:
    servers = NatsServers(tmp_path / "servers", 1)
    yield servers
    servers.close()


@pytest.fixture
def three_servers(tmp_path: Path) -> Iterator[NatsServers]:
    servers = NatsServers(tmp_path / "servers", 3, store=8 << 20)
    yield servers
    servers.close()


def opened(servers: NatsServers) -> JetStreamLog:
    return JetStreamLog(*log_in(servers.address("x")))


def read_all(log: JetStreamLog, last: int) -> list[int]:
    """Read a log up to a message. Return the numbers of its messages."""
    seen: list[int] = []
    while len(seen) < last:
        seen += [message.sequence for message in log.read(len(seen), 1)]
    return seen


@pytest.mark.slow
def test_standby_starts_no_run_and_follows_the_next(
    one_server: NatsServers, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(members, "SILENT", 0.2)
    log = opened(one_server)
    last = log.append(Kind.TURN, [encode([Ended("SIGINT")])], 0)  # all that is left of a run
    standby = Member(opened(one_server), "ipc:///b", tmp_path / "b", Store())
    is_over, results = threading.Event(), list[bool]()
    thread = threading.Thread(target=lambda: results.append(standby.stand_by(is_over.is_set)))
    thread.start()
    time.sleep(1)  # it would have started a run
    assert log.last() == last
    leader = Member(log, "ipc:///a", tmp_path / "a", Store())
    leader.begin(is_fresh=False)
    leader.close()
    thread.join(30)
    assert results == [True]
    assert standby.central.epoch == leader.central.epoch
    standby.close()


@pytest.mark.slow
def test_standby_of_an_empty_log_waits_until_it_must_end(
    one_server: NatsServers, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(members, "SILENT", 0.1)
    standby = Member(opened(one_server), "ipc:///b", tmp_path / "b", Store())
    until_time = time.monotonic() + 0.5
    assert not standby.stand_by(lambda: time.monotonic() > until_time)
    standby.close()


@pytest.mark.soak
def test_quorum_loss_lets_writer_and_reader_wait(three_servers: NatsServers) -> None:
    log, reader = opened(three_servers), opened(three_servers)
    last = log.append(Kind.TURN, [b"a"] * 3, 0)
    assert read_all(reader, last) == [1, 2, 3]
    for number in (1, 2):
        three_servers.kill(number)
    results: list[int] = []
    thread = threading.Thread(target=lambda: results.append(log.append(Kind.TURN, [b"b"], last)))
    thread.start()
    thread.join(8)
    assert not results
    for number in (1, 2):
        three_servers.start(number)
    thread.join(60)
    assert results == [4]
    assert [one.sequence for one in reader.read(3, 30)] == [4]
    log.close()
    reader.close()


@pytest.mark.soak
def test_reader_continues_when_all_servers_restart(three_servers: NatsServers) -> None:
    """The readers of JetStream begin again then: their places are in memory."""
    log, reader = opened(three_servers), opened(three_servers)
    last = log.append(Kind.TURN, [b"a"] * 10, 0)
    assert read_all(reader, last) == list(range(1, 11))
    for number in range(3):
        three_servers.end(number)
        three_servers.start(number)
    assert log.append(Kind.TURN, [b"b"], last) == 11
    assert [one.sequence for one in reader.read(10, 30)] == [11]
    log.close()
    reader.close()


@pytest.mark.soak
def test_full_cluster_loses_nothing_that_was_acknowledged(three_servers: NatsServers) -> None:
    log, acknowledged, is_over = opened(three_servers), [0], threading.Event()

    def write() -> None:
        while not is_over.is_set():
            last = acknowledged[-1]
            acknowledged.append(log.append(Kind.TURN, [bytes(400_000)] * (1 + last % 3), last))

    thread = threading.Thread(target=write)
    thread.start()
    time.sleep(10)
    full = acknowledged[-1]
    time.sleep(2)
    assert acknowledged[-1] == full
    three_servers.store = 1 << 30
    for number in range(3):
        three_servers.kill(number)
        three_servers.start(number)
        time.sleep(3)
    until(lambda: acknowledged[-1] > full + 10, "it continues")
    is_over.set()
    thread.join(60)
    assert read_all(log, acknowledged[-1]) == list(range(1, acknowledged[-1] + 1))
    log.close()
