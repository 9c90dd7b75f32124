"""The library over real sockets: wake-ups of slots, addresses, and a process's open files."""

import asyncio
import queue
import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from module.real_central import SOON, RealCentral, disable_polling, until
from module.robot import MOVE_LEG, REST, STANCE, TEMPERATURE, Footfall

from tca_module import (
    TIMEOUT,
    Callback,
    Command,
    LaterReply,
    MisuseError,
    Module,
    Outcome,
    Task,
    TaskFailed,
    connect,
)
from tca_module.sockets.transport import DealerTransport

pytestmark = pytest.mark.usefixtures("short_timeouts")


REST_LEG = Command("rest leg")


@pytest.fixture
def central(address: str) -> Iterator[RealCentral]:
    with RealCentral(address) as central:
        yield central


@pytest.fixture
def address(tmp_path: Path) -> str:
    return f"ipc://{tmp_path}/central.sock"


def test_transport_refuses_packet_without_peer(address: str) -> None:
    transport = DealerTransport(address)
    assert not transport.send(b"packet", 0.05)
    assert transport.receive(0.01) is None
    transport.wake()
    transport.close()


def test_malformed_central_address_is_misuse(tmp_path: Path) -> None:
    with pytest.raises(
        MisuseError, match=r"central's address must be .*'tcp://host:port', not 'somewhere'"
    ):
        connect("user", "somewhere")


def test_coroutines_wake_for_every_arrival(
    central: RealCentral, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The file of a ZeroMQ socket signals only changes. A packet that a blocking call has read must
    not be missed.
    """
    legs, eyes = Module("legs", central.address), Module("eyes", central.address, capacity=4)
    eyes.handles(STANCE)(lambda _, radius: [int(radius)])

    @legs.handles(TEMPERATURE)
    async def temperature(task: Task) -> float:
        total = 0
        for turn in range(50):
            pending = [
                asyncio.ensure_future(task.query_send(STANCE, float(turn))) for _ in range(4)
            ]
            await asyncio.sleep(0)
            total += task.query(STANCE, 0.0)[0]
            task.command(REST_LEG, sequential=False)
            total += sum(stance[0] for stance in await asyncio.gather(*pending))
        return float(total)

    @legs.handles(REST)
    async def rest(task: Task) -> None:
        await asyncio.Event().wait()

    with legs.running(), eyes.running(), connect("user", central.address) as user:
        with monkeypatch.context() as patch:
            disable_polling(patch)
            assert user.query(TEMPERATURE, timeout=SOON) == 4 * sum(range(50))
        rested = user.goal(REST)
        rested.wait_for(rested.handling.start, SOON)
        rested.kill("enough")
        assert rested.wait(SOON) is Outcome.KILLED


def test_threads_timers_and_files_wake_slot(
    central: RealCentral, monkeypatch: pytest.MonkeyPatch
) -> None:
    legs, jobs = Module("legs", central.address), queue.Queue[LaterReply[Footfall]]()
    near, far = socket.socketpair()

    @legs.handles(MOVE_LEG)
    def move_leg(task: Task, leg: int) -> LaterReply[Footfall]:
        later = task.reply_later()
        jobs.put(later)
        return later

    @legs.every(0.001, resource="legs")
    def ask_device(callback: Callback) -> None:
        if not jobs.empty():
            far.send(b"go")

    def device() -> None:
        near.recv(100)
        if not jobs.empty():  # the timer may have signalled this job twice
            jobs.get().reply(Footfall(1, 0.0))

    with near, far, legs.running(), connect("user", central.address) as user:
        disable_polling(monkeypatch)
        for _ in range(20):  # the test's own thread answers
            move = user.command(MOVE_LEG, 1)
            jobs.get(timeout=SOON).reply(Footfall(1, 0.0))
            move.result(SOON)
        legs.on_readable(near, device)
        for _ in range(20):  # a timer sees the job, a file signals another thread
            user.command(MOVE_LEG, 1).result(SOON)


def test_pulse_ends_with_last_connection_to_central(address: str) -> None:
    """All connections of a process to one central share one pulse."""
    with RealCentral(address), RealCentral(f"{address}-2") as other:
        with connect("first", address):  # opens the files that ZeroMQ opens once per process
            pass
        before = files_here()
        first, second = connect("first", address), connect("second", address)
        third = connect("third", other.address)
        assert pulses_here() == 2
        first.close()
        assert pulses_here() == 2
        second.close()
        assert pulses_here() == 1
        third.close()
        third.close()
        assert pulses_here() == 0
        until(lambda: files_here() <= before, "every file is closed")


def files_here() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


def pulses_here() -> int:
    return sum(thread.name == "pulse" for thread in threading.enumerate())


def test_wait_around_a_late_task_ends_with_its_result(central: RealCentral) -> None:
    """The timeout can't interrupt the task within the wait: it has the thread. Its deadline can."""
    legs, lift, climb = Module("legs", central.address), Command("lift", float), Command("climb")
    legs.handles(lift)(lambda task, seconds: task.sleep(seconds))

    @legs.handles(climb)
    def climbs(task: Task) -> None:
        assert task.command(lift, 0.03).wait(timeout=0.01) is Outcome.DONE
        task.command(lift, 2 * SOON, deadline=0.1).wait(timeout=0.01)

    with legs.running(), connect("user", central.address) as user:
        with pytest.raises(TaskFailed) as caught:
            user.command(climb).result(SOON)
        assert caught.value.failure == TIMEOUT.name
