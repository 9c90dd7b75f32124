"""Central on a replicated log: a standby takes over when the leader is gone.

One real NATS server has the log. tests/chaos has lives with three servers that die, too.
"""

import os
import pty
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from module.real_central import until
from nats_servers import NatsServers
from processes import Central, central

from tca_central.replication.jetstream import JetStreamLog
from tca_central.replication.shared_log import log_in
from tca_central.shell.store import ROOT
from tca_module import Client, Command, Module, Query, Task, connect
from tca_tools.journal.journals import open_log
from tca_tools.journal.segments import segments_in
from tca_wire.journal import facts

SQUARE = Query("square", int, reply=int)
KEEP = Command("keep", bytes, result=int)
STANDBY = ("tca", "standby")


@pytest.fixture
def servers(tmp_path: Path) -> Iterator[NatsServers]:
    servers = NatsServers(tmp_path, 1)
    try:
        yield servers
    finally:
        servers.close()


@pytest.fixture
def leader(servers: NatsServers, tmp_path: Path) -> Iterator[Central]:
    with central(tmp_path / "a", "--log", servers.address()) as leader:
        yield leader


@pytest.fixture
def standby(leader: Central, servers: NatsServers, tmp_path: Path) -> Iterator[Central]:
    """A second central, which follows *leader*."""
    with central(tmp_path / "b", "--log", servers.address(), command=STANDBY) as standby:
        yield standby


@pytest.fixture
def user(leader: Central, standby: Central) -> Iterator[Client]:
    """A client, and in the same process a module that handles its messages."""
    addresses = f"{leader.address},{standby.address}"
    arm = Module("arm", addresses)
    arm.handles(SQUARE, resource="sums")(lambda _, number: number * number)

    @arm.handles(KEEP)
    def keep(_: Task, data: bytes) -> int:
        (leader.journal.parent / f"begun {len(data)}").touch()
        while (leader.journal.parent / "hold").exists():
            time.sleep(0.01)
        return len(data)

    with arm.running(), connect("user", addresses) as user:
        user.wait_until_handled(KEEP)
        yield user


def hears(central: Central, words: str) -> str:
    """Return the next line of a central's output that has these words."""
    with central.process.killed_after(60):
        return next(line for line in central.process.stderr if words in line)


def test_query_is_answered_after_the_leader_is_killed(
    user: Client, leader: Central, standby: Central
) -> None:
    assert user.query(SQUARE, 3) == 9
    leader.kill()
    assert user.query(SQUARE, 4) == 16
    assert user.address == standby.address


def test_handler_and_ids_continue_when_a_standby_takes_over(
    user: Client, leader: Central, standby: Central
) -> None:
    hold = leader.journal.parent / "hold"
    hold.touch()
    first, second = user.command(KEEP, b"1"), user.command(KEEP, b"22")
    until((leader.journal.parent / "begun 1").exists, "the first command begins")
    leader.kill()
    hears(standby, "leads now")
    hold.unlink()
    assert (first.result(), second.result()) == (1, 2)
    assert user.command(KEEP, b"").id == second.id + 1
    assert len([one for one in standby.facts(facts.Received) if one.message == KEEP.name]) == 3


def test_stopped_leader_follows_when_it_continues(
    user: Client, leader: Central, standby: Central
) -> None:
    leader.signal(signal.SIGSTOP)
    hears(standby, "leads now")
    leader.signal(signal.SIGCONT)
    hears(leader, "follows the log;")
    assert user.query(SQUARE, 5) == 25
    standby.kill()
    assert user.query(SQUARE, 6) == 36
    assert user.address == leader.address


def test_large_data_come_from_the_log_when_memory_is_lost(
    user: Client, leader: Central, standby: Central, servers: NatsServers
) -> None:
    hold = leader.journal.parent / "hold"
    hold.touch()
    user.command(KEEP, b"")
    waiting = user.command(KEEP, bytes(3 << 20))
    memory = ROOT / f"tca-{os.getuid()}-{user.status('status')['epoch']}"
    shared = JetStreamLog(*log_in(servers.address()))
    until(shared.bodies, "the data of the waiting task are in the log")
    shared.close()
    leader.kill()
    shutil.rmtree(memory)
    hears(standby, "leads now")
    hold.unlink()
    assert waiting.result() == 3 << 20


def test_end_of_the_run_ends_the_standby(leader: Central, standby: Central) -> None:
    until(
        lambda: any(one.standbys for one in leader.facts(facts.MembersChanged)),
        "the leader knows that the standby follows",
    )
    leader.signal(signal.SIGINT)
    assert standby.process.wait() == 0
    (closed,) = standby.facts(facts.Closed)
    assert closed.why == signal.SIGINT.name


def test_terminated_leader_leaves_the_run_to_a_standby(
    user: Client, leader: Central, standby: Central
) -> None:
    leader.signal(signal.SIGTERM)  # as a computer that is turned off
    assert leader.process.wait() == 0
    assert user.query(SQUARE, 8) == 64
    assert user.address == standby.address


def test_leader_leaves_the_run_when_its_terminal_is_closed(
    servers: NatsServers, tmp_path: Path
) -> None:
    near, far = pty.openpty()
    log = ("--log", servers.address())
    where = ("--bind", f"ipc://{tmp_path}/a.sock", "--journal", str(tmp_path / "a"))
    command = [sys.executable, "-m", "tca_central", *where, *log]
    with subprocess.Popen(
        command, stdin=far, stdout=far, stderr=far, start_new_session=True
    ) as leader:
        os.close(far)
        assert b"listening" in os.read(near, 200)
        with central(tmp_path / "b", *log, command=STANDBY) as standby:
            until(standby.journal.exists, "it follows")
            os.close(near)
            leader.send_signal(signal.SIGHUP)
            hears(standby, "leads now")


def test_standby_that_can_not_listen_is_refused(
    leader: Central, servers: NatsServers, tmp_path: Path
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        bind = f"tcp://127.0.0.1:{other.getsockname()[1]}"
        log = ("--log", servers.address())
        with central(tmp_path / "b", *log, bind=bind, command=STANDBY) as standby:
            assert standby.process.wait() == 1


def test_manual_standby_tells_how_it_leads(
    leader: Central, servers: NatsServers, tmp_path: Path
) -> None:
    options = ("--log", servers.address(), "--manual")
    with central(tmp_path / "b", *options, command=STANDBY) as standby:
        until(standby.journal.exists, "it follows")
        leader.kill()
        hears(standby, f"kill -USR2 {standby.process.pid}")
        standby.signal(signal.SIGUSR2)
        hears(standby, "leads now")


def test_second_central_follows_the_first(
    leader: Central, servers: NatsServers, tmp_path: Path
) -> None:
    with central(tmp_path / "b", "--log", servers.address()) as second:
        assert leader.address in second.first_line
        hears(second, "follows the log;")


def test_fresh_run_is_refused_while_another_one_is_led(
    leader: Central, servers: NatsServers, tmp_path: Path
) -> None:
    with central(tmp_path / "b", "--log", servers.address(), "--fresh") as second:
        assert second.process.wait() == 1
        assert leader.address in second.first_line


def test_standby_leads_on_demand(user: Client, leader: Central, standby: Central) -> None:
    standby.signal(signal.SIGUSR2)
    hears(standby, "leads now")
    hears(leader, "follows the log;")
    assert user.query(SQUARE, 7) == 49


def test_journal_of_a_restarted_standby_has_no_hole(
    leader: Central, servers: NatsServers, tmp_path: Path
) -> None:
    for _ in range(3):
        with central(tmp_path / "b", "--log", servers.address(), command=STANDBY) as standby:
            until(standby.journal.exists, "the standby has a journal")
            before = len(segments_in(standby.journal))
            until(
                lambda: len(segments_in(standby.journal)) > before,  # noqa: B023 - at once
                "the standby writes",
            )
            standby.kill()
    numbers = [entry.number for entry in open_log(standby.journal) if entry.cause is not None]
    assert numbers == list(range(1, len(numbers) + 1))
