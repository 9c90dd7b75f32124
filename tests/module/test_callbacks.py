"""Functions that a module's threads call between messages: at times, and when files become
readable.
"""

import math
import queue
import socket
import threading
from collections.abc import Iterator

import pytest
from module.real_central import SOON
from module.robot import MOVE_LEG, STANCE, TEMPERATURE, Footfall

from tca_module import Callback, Client, MisuseError, Module, Task
from tca_module.checks import check_function
from tca_module.link.connection import Connection
from tca_module.log import log_of
from tca_module.serving.callbacks import Callbacks, DueTime
from tca_module.session.session import Session
from tca_module.testing import LocalCentral
from tca_wire.journal.facts import Received
from tca_wire.packets.headers import PROTOCOL_VERSION, Hello


@pytest.fixture
def line() -> Iterator[tuple[socket.socket, socket.socket]]:
    """Yield the two ends of a line: the module's and the device's."""
    near, far = socket.socketpair()
    with near, far:
        yield near, far


class Clock:
    """The callbacks of a thread, on the test's own clock."""

    def __init__(self) -> None:
        self.now = 100.0
        self.callbacks = Callbacks("legs")

    def time(self) -> float:
        return self.now

    def seconds_until(self, moment: float) -> float:
        return moment - self.now

    def wake(self) -> None:
        """Do nothing, because no thread waits."""

    def begin(self) -> None:
        connection = Connection.__new__(Connection)
        connection.transport = self  # type: ignore[assignment]
        connection.session = Session(Hello(0, PROTOCOL_VERSION, "legs", "run"))
        connection._lock = threading.RLock()
        connection.log = log_of("legs")
        self.callbacks.begin(connection)

    def advance(self, seconds: float, ready: dict[int, bool] | None = None) -> None:
        """Wait as a slot does, and call the callbacks that are due."""
        self.now += seconds
        if self.callbacks.connection is not None:
            self.callbacks.queue_due(ready or {})
        while self.callbacks.call_one():
            pass


@pytest.fixture
def clock() -> Clock:
    return Clock()


def test_delay_counts_from_module_start(clock: Clock) -> None:
    called: list[float] = []
    clock.callbacks.after(2.0, lambda: called.append(clock.now))
    clock.advance(50.0)
    clock.begin()
    clock.callbacks.after(1.0, lambda: called.append(clock.now))
    assert clock.callbacks.seconds_until_due(0.2) == 0.2
    clock.advance(0.9)
    assert clock.callbacks.seconds_until_due(0.2) == pytest.approx(0.1)
    clock.advance(0.1)
    clock.advance(1.0)
    clock.advance(9.0)
    assert called == [151.0, 152.0]
    assert not clock.callbacks


def test_default_arguments_of_callback_are_kept(clock: Clock) -> None:
    called: list[object] = []
    for n in (1, 2):
        clock.callbacks.every(1.0, lambda n=n: called.append(n))
    clock.callbacks.every(1.0, lambda callback, n=n: called.append((type(callback), n)))
    clock.begin()
    clock.advance(1.0)
    assert called == [1, 2, (Callback, 2)]
    assert check_function("observes()", lambda change, n=n: (change, n), "(change)", (2, 1)) == 1


def test_failing_callback_stops_no_other(clock: Clock, caplog: pytest.LogCaptureFixture) -> None:
    called: list[str] = []

    def fails(callback: Callback) -> None:
        called.append("fails")
        raise SystemExit if len(called) > 2 else OSError("hot")

    clock.callbacks.every(1.0, fails)
    clock.callbacks.every(1.0, lambda: called.append("works"))
    clock.begin()
    clock.advance(1.0)
    clock.advance(1.0)
    assert called == ["fails", "works"] * 2
    assert [record.getMessage() for record in caplog.records] == [
        "callback test_failing_callback_stops_no_other.<locals>.fails failed"
    ] * 2
    assert "OSError: hot" in caplog.text


def test_callback_is_cancelled_from_inside_and_outside(clock: Clock) -> None:
    called: list[str] = []

    def thrice(callback: Callback) -> None:
        called.append("thrice")
        if len(called) == 3:
            assert not callback.is_over
            callback.cancel()
            callback.cancel()
            assert callback.is_over

    def once(callback: Callback) -> None:
        assert callback.is_over
        called.append("once")

    clock.callbacks.every(1.0, thrice)
    never = clock.callbacks.after(0.5, once)
    clock.begin()
    never.cancel()
    assert never.is_over
    for _ in range(5):
        clock.advance(1.0)
    assert called == ["thrice"] * 3
    once_more = clock.callbacks.after(0.0, once)
    assert not once_more.is_over
    clock.advance(0.0)
    assert called[-1] == "once"


def test_callback_cancels_another_due_callback(clock: Clock) -> None:
    called: list[str] = []
    clock.callbacks.after(1.0, lambda: other.cancel())  # noqa: PLW0108 - not there yet
    other = clock.callbacks.after(1.0, lambda: called.append("other"))
    clock.begin()
    clock.advance(1.0)
    assert not called


def test_remaining_callbacks_restart_with_next_run(clock: Clock) -> None:
    called: list[float] = []
    clock.callbacks.every(1.0, lambda: called.append(clock.now))
    once = clock.callbacks.after(1.5, lambda: called.append(0.0))
    clock.begin()
    clock.advance(1.0)
    clock.callbacks.end()
    clock.advance(5.0)
    assert called == [101.0]
    with pytest.raises(MisuseError, match=r"callback .* can't send: its module is not running"):
        once.query(TEMPERATURE)
    clock.begin()
    clock.advance(1.0)
    clock.advance(0.5)
    assert called == [101.0, 107.0, 0.0]


def test_closed_file_is_no_longer_watched(clock: Clock, caplog: pytest.LogCaptureFixture) -> None:
    called: list[str] = []
    watch = clock.callbacks.on_readable(77, lambda: called.append("readable"))
    clock.begin()
    clock.advance(0.0, {77: True})
    assert called == ["readable"]
    clock.advance(0.0, {77: False})
    assert watch.is_over
    assert not clock.callbacks.files
    assert "is not called any more: file 77 is closed" in caplog.text
    clock.advance(0.0, {77: True})  # found readable before the watch was removed
    assert called == ["readable"]


def test_second_callback_for_file_is_misuse(
    legs: Module, line: tuple[socket.socket, socket.socket]
) -> None:
    near, far = line
    first = legs.on_readable(near, print)
    with pytest.raises(MisuseError, match=r"callback print waits for file .* already: cancel"):
        legs.on_readable(near.fileno(), print)
    first.cancel()
    legs.on_readable(near, print)
    far.close()
    with pytest.raises(MisuseError, match="source must be an open file"):
        legs.on_readable(far, print)


def test_callback_sends_under_root(legs: Module, central: LocalCentral) -> None:
    moved = queue.Queue[tuple[str, Footfall]]()
    legs.handles(MOVE_LEG)(lambda _, leg: Footfall(leg, 0.5))

    @legs.every(0.01)
    def march(callback: Callback) -> None:
        foot = callback.command(MOVE_LEG, 2).result(SOON)
        moved.put((threading.current_thread().name, foot))
        callback.cancel()

    with legs.running():
        thread, foot = moved.get(timeout=SOON)
        assert (thread.split()[0], foot) == ("callbacks", Footfall(2, 0.5))
    assert [fact.parent for fact in central.facts if isinstance(fact, Received)] == [0]


def test_callbacks_and_handlers_of_resource_take_turns(legs: Module, user: Client) -> None:
    """A resource has one thread, so neither callbacks nor handlers need locks."""
    threads, go = queue.Queue[str](), threading.Event()

    @legs.handles(TEMPERATURE, resource="arm")
    def temperature(task: Task) -> float:
        legs.after(
            0.0, lambda: threads.put("callback " + threading.current_thread().name), resource="arm"
        )
        go.wait(SOON)
        threads.put("handler " + threading.current_thread().name)
        return 36.6

    with legs.running():
        pending = user.query_send(TEMPERATURE)
        go.set()
        assert pending.receive(SOON) == 36.6
        assert [threads.get(timeout=SOON) for _ in range(2)] == ["handler arm 1", "callback arm 1"]
        with pytest.raises(
            MisuseError, match="resource 'leg' of module 'legs' has no thread: before run"
        ):
            legs.after(0.0, print, resource="leg")


def test_callback_thread_starts_on_first_use(legs: Module, user: Client) -> None:
    rang = queue.Queue[str]()

    @legs.handles(TEMPERATURE)
    def temperature(task: Task) -> float:
        legs.after(0.0, lambda: rang.put(threading.current_thread().name))
        return 36.6

    for _ in range(2):
        with legs.running():
            assert user.query(TEMPERATURE, timeout=SOON) == 36.6
            assert rang.get(timeout=SOON) == "callbacks 2"


def test_files_timers_and_coroutines_share_slot_thread(
    legs: Module, user: Client, line: tuple[socket.socket, socket.socket]
) -> None:
    near, far = line
    packets, beats = queue.Queue[tuple[str, bytes]](), queue.Queue[str]()

    @legs.handles(STANCE)
    async def stance(task: Task, radius: float) -> list[int]:
        return [int(radius)]

    legs.on_readable(
        near,
        lambda: packets.put((threading.current_thread().name, near.recv(100))),
        resource="legs",
    )
    legs.every(0.01, resource="legs")(lambda: beats.put(threading.current_thread().name))
    with legs.running():
        for number in range(3):
            assert user.query(STANCE, float(number), timeout=SOON) == [number]
            far.send(b"word")
            assert packets.get(timeout=SOON) == ("legs 1", b"word")
            assert beats.get(timeout=SOON) == "legs 1"


def test_closed_file_is_noticed_by_waiting_slot(
    legs: Module, user: Client, caplog: pytest.LogCaptureFixture
) -> None:
    """The slot has an event loop in the second round only."""
    rang = queue.Queue[str]()

    @legs.handles(TEMPERATURE)
    async def temperature(task: Task) -> float:
        return 36.6

    with legs.running():
        for _ in range(2):
            legs.after(0.0, lambda: rang.put("has opened its own files"), resource="legs")
            assert rang.get(timeout=SOON)
            near, far = socket.socketpair()
            watch = legs.on_readable(near, print, resource="legs")
            near.close()
            far.close()
            legs.after(0.05, lambda: rang.put("still here"), resource="legs")
            assert rang.get(timeout=SOON) == "still here"
            assert watch.is_over
            assert user.query(TEMPERATURE, timeout=SOON) == 36.6
    assert caplog.text.count("is closed") == 2


# --- Due times of timers, on the test's own clock -------------------------------------------------


def test_one_shot_timer_is_due_once() -> None:
    time = DueTime(5.0, is_once=True)
    assert time.due == math.inf
    time.begin(2.0)
    assert time.due == 7.0
    time.due = math.inf
    time.schedule_next(8.0)
    assert time.due == math.inf


def test_period_does_not_drift() -> None:
    time = DueTime(0.1, is_once=False)
    time.begin(100.0)
    for turn in range(1, 1001):
        assert time.due == pytest.approx(100.0 + turn * 0.1, abs=1e-9)
        time.schedule_next(time.due + 0.04)  # always a little late


def test_missed_periods_are_skipped() -> None:
    """After a stall, or a long call, the next call is at a multiple of the period again."""
    time = DueTime(1.0, is_once=False)
    time.begin(0.0)
    time.schedule_next(9.4)
    assert time.due == 10.0


def test_call_ending_at_next_due_time_is_not_repeated() -> None:
    time = DueTime(0.1, is_once=False)
    time.begin(0.0)
    times: list[float] = []
    for _ in range(1000):
        times.append(time.due)
        time.schedule_next(times[-1])
    assert len(set(times)) == 1000
