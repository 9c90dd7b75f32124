"""The library over real sockets: one central in a thread."""

import asyncio
import queue
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from module.real_central import SOON, RealCentral, until
from module.robot import MOVE_LEG, REST, STANCE, TEMPERATURE, Footfall

from tca_module import Callback, Command, LaterReply, MisuseError, Module, Outcome, Task, connect
from tca_module.sockets.transport import DealerTransport

pytestmark = pytest.mark.usefixtures("attentive")

REST_LEG = Command("rest leg")


@pytest.fixture
def address(tmp_path: Path) -> str:
    return f"ipc://{tmp_path}/central.sock"


@pytest.fixture
def central(address: str) -> Iterator[str]:
    """The address of a central that runs."""
    with RealCentral(address):
        yield address


def test_a_socket_does_not_take_what_nobody_is_there_for(address: str) -> None:
    transport = DealerTransport(address)
    assert not transport.send(b"packet", 0.05)
    assert transport.receive(0.01) is None
    transport.wake()
    transport.close()


def test_an_address_that_is_none(tmp_path: Path) -> None:
    with pytest.raises(MisuseError, match=r"central's address must be .*'tcp://host:port', not 'somewhere'"):
        connect("user", "somewhere")


def test_coroutines_hear_all_that_arrives(central: str) -> None:
    """A ZeroMQ socket's file tells only of changes: what a blocking call has read meanwhile must not be missed."""
    legs, eyes = Module("legs", central), Module("eyes", central, capacity=4)
    eyes.handles(STANCE)(lambda _, radius: [int(radius)])

    @legs.handles(TEMPERATURE)
    async def temperature(task: Task) -> float:
        total = 0
        for turn in range(50):
            pending = [asyncio.ensure_future(task.query_send(STANCE, float(turn))) for _ in range(4)]
            await asyncio.sleep(0)
            total += task.query(STANCE, 0.0)[0]
            task.command(REST_LEG, sequential=False)
            total += sum(stance[0] for stance in await asyncio.gather(*pending))
        return float(total)

    @legs.handles(REST)
    async def rest(task: Task) -> None:
        await asyncio.Event().wait()

    with legs.running(), eyes.running(), connect("user", central) as user:
        began = time.monotonic()
        assert user.query(TEMPERATURE, timeout=SOON) == 4 * sum(range(50))
        assert time.monotonic() - began < 50 * 0.1  # each thing that is missed costs a step of 0.2 s
        rested = user.goal(REST)
        rested.wait_for(rested.handling.start, SOON)
        rested.kill("enough")
        assert rested.wait(SOON) is Outcome.KILLED


def test_other_threads_timers_and_files_wake_a_slot(central: str) -> None:
    legs, jobs = Module("legs", central), queue.Queue[LaterReply[Footfall]]()
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
        if not jobs.empty():  # the timer may have told of this job twice
            jobs.get().reply(Footfall(1, 0.0))

    with near, far, legs.running(), connect("user", central) as user:
        began = time.monotonic()
        for _ in range(20):  # the test's own thread answers
            move = user.command(MOVE_LEG, 1)
            jobs.get(timeout=SOON).reply(Footfall(1, 0.0))
            move.result(SOON)
        legs.on_readable(near, device)
        for _ in range(20):  # a timer sees the job, a file tells another thread
            user.command(MOVE_LEG, 1).result(SOON)
        assert time.monotonic() - began < 40 * 0.1


def test_nothing_stays_of_a_pulse_when_its_last_connection_is_closed(address: str) -> None:
    """All connections of a process to one central share one."""
    with RealCentral(address), RealCentral(f"{address}-2") as other:
        with connect("first", address):  # what ZeroMQ has once for a process is there from now on
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
