"""Central at one of several addresses: programs find it, and move when it moves."""

import asyncio
import signal
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner
from module.real_central import SOON, Gate, RealCentral, until
from processes import Central, central

from tca_central.shell import server
from tca_module import CentralLost, Command, MisuseError, Module, Query, Task, aconnect, connect
from tca_module.link import packet_line
from tca_module.sockets import transport
from tca_module.sockets.transport import DealerTransport
from tca_tools.live.questions import status
from tca_wire.journal.facts import Received

MOVE, WHERE = Command("move", int, result=int), Query("where", reply=str)


@pytest.fixture
def addresses(tmp_path: Path) -> list[str]:
    return [f"ipc://{tmp_path}/{name}" for name in "abc"]


@pytest.fixture
def anywhere(addresses: list[str]) -> str:
    """Return the list of addresses, as $TCA_CENTRAL has it."""
    return ",".join(addresses)


@pytest.fixture
def stopped(addresses: list[str]) -> Iterator[str]:
    """A program that listens at the first address, and stands still."""
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(addresses[0].removeprefix("ipc://"))
        listener.listen()
        yield addresses[0]


# --- the first connection ---------------------------------------------------------------------------


@pytest.mark.parametrize("number", [0, 1, 2])
def test_client_finds_central_at_each_address_of_a_list(
    addresses: list[str], anywhere: str, number: int
) -> None:
    with (
        RealCentral(addresses[number]),
        connect("one", anywhere) as one,
        connect("other", " , ".join(addresses)) as other,
    ):
        assert (one.address, other.address) == (addresses[number],) * 2


def test_client_passes_over_a_program_that_stands_still(
    addresses: list[str], anywhere: str, stopped: str
) -> None:
    with RealCentral(addresses[1]), connect("user", anywhere) as user:
        assert user.address == addresses[1]


def test_error_names_all_addresses(addresses: list[str], anywhere: str, stopped: str) -> None:
    with pytest.raises(CentralLost) as caught:
        connect("user", anywhere, patience=0.3)
    text = str(caught.value)
    assert all(one in text for one in addresses)
    assert f"at {stopped} it accepts connections, but its process is stopped" in text


@pytest.mark.parametrize(
    ("listed", "named"),
    [
        ("ipc:///a,,ipc:///b", "empty"),
        ("ipc:///a, ", "empty"),
        ("ipc:///a,tcp://x", "'tcp://x'"),
        ("tcp://robot:7400,tcp://other:0", "'tcp://other:0'"),
        ("tcp://robot:7400,tcp://two words:7400", "'tcp://two words:7400'"),
        ("ipc:///a,http://robot:7400", "'http://robot:7400'"),
        ("ipc:///a,tcp://robot:7400", "'tcp://robot:7400'"),
        ("ipc:///a,ipc:///b,ipc:///a", "'ipc:///a'"),
        (f"ipc:///a,ipc:///{'b' * 120}", "b" * 120),
    ],
)
def test_wrong_list_names_the_address(listed: str, named: str) -> None:
    with pytest.raises(MisuseError) as caught:
        connect("user", listed)
    assert named in str(caught.value).partition(f"'{listed}': ")[2]
    shown = CliRunner().invoke(status, ["--central", listed])
    assert (shown.exit_code, named in shown.output) == (2, True)


def test_wait_does_not_spin_while_central_is_away(anywhere: str) -> None:
    away, since = DealerTransport(anywhere), time.monotonic()
    assert away.receive(0.05) is None
    assert time.monotonic() - since >= 0.05
    away.close()


# --- moves ------------------------------------------------------------------------------------------


def test_task_goes_on_when_its_run_moves(
    tmp_path: Path, addresses: list[str], anywhere: str
) -> None:
    legs, gate = Module("legs", anywhere), Gate(7)
    legs.handles(MOVE)(gate)
    first = Central(tmp_path / "run", bind=addresses[0])
    try:
        with legs.running(), connect("user", anywhere) as user:
            moved = user.command(MOVE, 1)
            assert gate.begun.wait(SOON)
            first.kill()
            with central(tmp_path / "run", bind=addresses[1]):  # it continues the run
                gate.go_on.set()
                assert moved.result(SOON) == 7
                assert gate.threads.qsize() == 1
                assert user.address == addresses[1]
    finally:
        gate.go_on.set()
        first.stop()


def test_coroutines_wait_through_a_move(
    tmp_path: Path, addresses: list[str], anywhere: str
) -> None:
    legs, gate = Module("legs", anywhere), Gate("here")
    legs.handles(WHERE, resource="head")(gate)
    first = Central(tmp_path / "run", bind=addresses[0])

    @legs.handles(MOVE)
    async def move(task: Task, number: int) -> int:
        where = await task.query_send(WHERE)
        return int(where == "here") + number

    async def use() -> int:
        async with aconnect("user", anywhere) as user:
            moved = await user.command(MOVE, 6)
            await asyncio.to_thread(gate.begun.wait, SOON)
            await asyncio.to_thread(first.kill)
            with central(tmp_path / "run", bind=addresses[1]):
                gate.go_on.set()
                return await moved.result(SOON)

    try:
        with legs.running():
            assert asyncio.run(use()) == 7
    finally:
        gate.go_on.set()
        first.stop()


def test_connections_of_a_process_move_together(addresses: list[str], anywhere: str) -> None:
    with RealCentral(addresses[0]), RealCentral(addresses[1]):
        one, other = DealerTransport(anywhere), DealerTransport(anywhere)
        alone = DealerTransport(addresses[0])
        until(lambda: not (one.is_lost() or other.is_lost()), "both are connected")
        before = one.pulse
        assert one.seek() not in (None, before)
        assert other.is_lost()
        assert other.seek() is not None
        later = DealerTransport(anywhere)
        assert {one.address, other.address, later.address} == {addresses[1]}
        assert (alone.is_lost(), alone.seek(), alone.address) == (False, None, addresses[0])
        for each in (one, other, alone, later):
            each.close()


def test_many_threads_find_a_central_that_has_moved(
    tmp_path: Path, addresses: list[str], anywhere: str
) -> None:
    first, found = Central(tmp_path / "run", bind=addresses[0]), list[str]()
    has_moved, are_ready = threading.Event(), threading.Barrier(9)

    def use(number: int) -> None:
        with connect(f"user {number}", anywhere, patience=SOON) as user:
            are_ready.wait(SOON)
            assert has_moved.wait(SOON)
            user.modules()
            found.append(user.address)

    threads = [threading.Thread(target=use, args=(number,)) for number in range(8)]
    for thread in threads:
        thread.start()
    are_ready.wait(SOON)
    first.kill()
    with central(tmp_path / "run", bind=addresses[2]):
        has_moved.set()
        for thread in threads:
            thread.join(SOON)
    assert found == [addresses[2]] * 8


def test_idle_module_leaves_a_central_that_stands_still(
    addresses: list[str], anywhere: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its pulse no longer feels heartbeats. It waits for no answer that would be late."""
    monkeypatch.setattr(server, "PULSE_PERIOD", 0.05)
    monkeypatch.setattr(transport, "_SILENT", 0.5)
    monkeypatch.setattr(packet_line, "_LOOK_PERIOD", 0.1)
    goes_on, legs = threading.Event(), Module("legs", anywhere)
    legs.handles(WHERE)(lambda _: "here")
    with RealCentral(addresses[0]) as first, legs.running():
        until(lambda: first.server._pulses._reached, "a heartbeat was sent")
        monkeypatch.setattr(first.server, "_run_due_work", lambda: goes_on.wait(SOON))
        with RealCentral(addresses[1], "other") as second, connect("user", second.address) as user:
            assert user.query(WHERE, timeout=SOON) == "here"
            goes_on.set()


def test_program_that_ends_waits_for_a_central_that_moves(
    tmp_path: Path, addresses: list[str], anywhere: str
) -> None:
    first, later = Central(tmp_path / "run", bind=addresses[0]), list[Central]()
    with connect("user", anywhere, on_leave="keep") as user:
        user.command(MOVE, 1)
        user.modules()  # the first command has arrived
        first.signal(signal.SIGSTOP)
        user.command(MOVE, 2)
        first.kill()
        starts = threading.Timer(
            0.3, lambda: later.append(Central(tmp_path / "run", bind=addresses[1]))
        )
        starts.start()
    starts.join()
    sent = [one for one in later[0].facts(Received) if one.message == MOVE.name]
    assert len(sent) == 2
    later[0].stop()
