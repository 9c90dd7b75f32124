"""A central whose clock the test steps. The central waits until all is quiet, so its transcript can
be compared.
"""

import asyncio
import threading
from collections.abc import Callable
from pathlib import Path

import pytest
from module.real_central import SOON

from tca_module import (
    Callback,
    CentralLost,
    Client,
    Command,
    Goal,
    Inform,
    LaterReply,
    MisuseError,
    Module,
    Outcome,
    PollingMonitor,
    Query,
    Task,
    Timeout,
    connect,
)
from tca_module.testing import LocalCentral

WALK, STEP, REST = Goal("walk", int), Command("step", int), Command("rest")
STEER, SAY, NEVER = Query("steer", int, reply=int), Inform("say", str), Query("never", reply=int)
IS_LOW = Query("is low", reply=bool)
BATTERY = PollingMonitor("battery", condition=IS_LOW, action=REST)
STEPPED = True  # the tests step the clock of central


def test_stepped_clock_stands_still_until_advanced(
    central: LocalCentral, user: Client, legs: Module
) -> None:
    done: list[str] = []
    legs.handles(REST)(lambda _: done.append("rest"))
    with legs.running():
        rest = user.command(REST, delay=3600)
        with pytest.raises(Timeout, match=r"call advance\(\)$"):
            rest.wait(timeout=0)
        central.until_quiet()
        central.advance(3599.5)
        assert not done
        central.advance(0.5)
        assert done == ["rest"]
        assert rest.info() is None


def test_monitor_tests_happen_at_their_due_times(
    central: LocalCentral, user: Client, legs: Module
) -> None:
    legs.handles(IS_LOW)(lambda _: len(central.entries) % 2 == 0)
    legs.handles(REST)(lambda _: None)
    with legs.running():
        user.monitor(BATTERY, period=10, initial_wait=True, duration=35)
        central.advance(40)
        times = [
            float(line.split()[0])
            for line in central.transcript().splitlines()
            if " tested: " in line
        ]
    assert times == [10, 20, 30]


def test_deadline_ends_waiting_handler(central: LocalCentral, user: Client, legs: Module) -> None:
    legs.handles(REST)(lambda task: task.query(NEVER, timeout=None))
    with legs.running():
        rest = user.command(REST, deadline=60)
        central.advance(59)
        assert rest.info() is not None
        central.advance(1)
        assert rest.wait(SOON) is Outcome.FAILED
        central.advance(100)


def run_plan(central: LocalCentral) -> str:
    """Run a plan of three steps in four threads that query a fifth, and return the transcript."""
    planner, legs, wheel = (Module(name, central) for name in ("planner", "legs", "wheel"))
    legs.resource("feet", capacity=3)

    @planner.handles(WALK)
    def walk(task: Task, steps: int) -> None:
        with task.parallel():
            for number in range(steps):
                task.command(STEP, number)
        task.inform(SAY, "planned")

    @legs.handles(STEP, resource="feet")
    def step(task: Task, number: int) -> None:
        task.inform(SAY, f"{number} steers {task.query(STEER, number)}")

    wheel.handles(STEER)(lambda _, number: -number)
    planner.handles(SAY)(lambda *_: None)
    with planner.running(), legs.running(), wheel.running(), connect("user", central) as user:
        user.goal(WALK, 3)
        central.until_quiet()
        user.goal(WALK, 1, delay=2.5)
        central.until_quiet()
        central.advance(3)
        return central.transcript()


def test_transcript_matches_approved_text(central: LocalCentral, *, rewrite: bool) -> None:
    """``pytest --rewrite`` rewrites the file. Commit only differences that you can explain."""
    approved = Path(__file__).parent / "stepped.txt"
    transcript = run_plan(central)
    if rewrite:
        approved.write_text(transcript)
    assert transcript == approved.read_text()


def test_transcript_is_same_in_each_run() -> None:
    for _ in range(10):
        with LocalCentral(stepped=True) as central:
            assert run_plan(central) == (Path(__file__).parent / "stepped.txt").read_text()


def test_until_quiet_waits_for_running_handler(
    user: Client, legs: Module, central: LocalCentral
) -> None:
    begun, go_on = threading.Event(), threading.Event()
    done: list[int] = []

    @legs.handles(REST)
    def rest(_: Task) -> None:
        begun.set()
        assert go_on.wait(SOON)
        done.append(1)

    with legs.running():
        user.command(REST)
        assert begun.wait(SOON)
        with pytest.raises(
            Timeout,
            match=r"not quiet within 0\.05 s: the handler of 'rest' is at work: let it wait",
        ):
            central.until_quiet(timeout=0.05)
        central.until_quiet(timeout=0.05, ignoring=[REST])
        central.advance(5, ignoring=[REST])
        assert not done
        threading.Timer(0.05, go_on.set).start()
        central.until_quiet()
        assert done


def test_until_quiet_returns_while_handlers_only_wait(
    user: Client, legs: Module, central: LocalCentral
) -> None:
    owed: list[LaterReply[None]] = []
    asked: list[str] = []

    @legs.handles(REST)
    def rest(task: Task) -> LaterReply[None]:
        owed.append(task.reply_later())
        return owed[0]

    @legs.handles(STEP, resource="hip")
    async def step(task: Task, number: int) -> None:
        asked.append("awaits")
        await task.query_send(NEVER)

    @legs.handles(WALK, resource="head")
    async def walk(_: Task, steps: int) -> None:
        await asyncio.sleep(0)
        asked.append("sleeps")
        await asyncio.sleep(3600)

    with legs.running():
        tasks = [user.command(REST, sequential=False), user.command(STEP, 1, sequential=False)]
        tasks += [user.goal(WALK, 1, sequential=False)]
        central.until_quiet()
        assert sorted(asked) == ["awaits", "sleeps"]
        threading.Thread(target=owed[0].reply).start()
        assert tasks[0].wait(SOON) is Outcome.DONE
        for task in tasks[1:]:
            task.kill()
        central.until_quiet()
        assert not central.core.dispatcher.running


def test_handler_blocked_on_event_does_not_stop_others(
    user: Client, legs: Module, central: LocalCentral
) -> None:
    released = threading.Event()

    @legs.handles(REST)
    def rest(_: Task) -> None:
        assert released.wait(SOON)

    legs.handles(STEP, resource="feet")(lambda *_: released.set())
    with legs.running():
        rests, step = user.command(REST), user.command(STEP, 1, sequential=False)
        assert (rests.wait(SOON), step.wait(SOON)) == (Outcome.DONE, Outcome.DONE)


def test_polling_handler_sees_cancellation(
    user: Client, legs: Module, central: LocalCentral
) -> None:
    begun = threading.Event()

    @legs.handles(REST)
    def rest(task: Task) -> None:
        begun.set()
        while not task.cancelled:
            threading.Event().wait(0.01)

    legs.handles(STEP, resource="feet")(lambda *_: None)
    with legs.running():
        rests = user.command(REST)
        assert begun.wait(SOON)
        assert user.command(STEP, 1, sequential=False).wait(SOON) is Outcome.DONE
        rests.kill()
        central.until_quiet()


def test_module_with_callbacks_is_quiet_between_them(
    user: Client, legs: Module, central: LocalCentral
) -> None:
    called = threading.Event()

    def call(callback: Callback) -> None:
        callback.inform(SAY, "called")
        called.set()

    legs.handles(SAY)(lambda *_: None)
    legs.after(0.01, call, resource="legs")
    with legs.running():
        central.advance(0.01)
        assert called.is_set()
        user.inform(SAY, "asked")
        central.until_quiet()
        assert central.transcript().count("returned: say") == 2


@pytest.mark.parametrize("is_async", [False, True])
def test_callbacks_follow_stepped_clock(
    user: Client, legs: Module, central: LocalCentral, *, is_async: bool
) -> None:
    called: list[float] = []

    async def walk(_: Task, steps: int) -> None:
        await asyncio.sleep(0)

    legs.handles(WALK)(walk if is_async else lambda *_: None)
    legs.every(10, resource="legs")(lambda: called.append(central.now()))
    legs.after(12, lambda: called.append(central.now()))
    with legs.running():
        user.goal(WALK, 1)
        central.advance(9)
        assert called == []
        central.advance(25)
        assert called == [10, 12, 20, 30]
        legs.after(1, lambda: called.append(central.now()))
        central.advance(0.5)
        user.goal(WALK, 1)
        central.advance(0.5)
        assert called[4:] == [35]


def test_real_clock_offers_until_quiet_and_transcript() -> None:
    with LocalCentral() as central:
        legs = Module("legs", central)
        legs.handles(REST)(lambda _: None)
        with legs.running(), connect("user", central) as user:
            user.command(REST)
            central.until_quiet()
            assert "returned: rest {1}: done" in central.transcript().splitlines()
        with pytest.raises(MisuseError, match=r"advance\(\) needs a stepped clock: .*stepped=True"):
            central.advance(1)


@pytest.mark.parametrize("stepped", [False, True])
def test_call_of_a_closed_central_fails_at_once(*, stepped: bool) -> None:
    central = LocalCentral(stepped=stepped)
    with connect("user", central) as user:
        walk = user.goal(WALK, 1)
        central.close()
        for call in (lambda: user.query(STEER, 1), walk.wait, lambda: connect("late", central)):
            with pytest.raises(CentralLost, match="'local' is closed"):
                call()


def test_wrong_clock_arguments_are_misuse(central: LocalCentral) -> None:
    wrong: list[tuple[Callable[[], object], str]] = [
        (lambda: central.advance(-1), "seconds must be 0 or more seconds"),
        (lambda: central.until_quiet(timeout=0), "timeout must be more than 0 seconds"),
        (lambda: central.until_quiet(ignoring="rest"), "ignoring must be a list of messages"),  # type: ignore[arg-type]
    ]
    for call, words in wrong:
        with pytest.raises(MisuseError, match=words):
            call()


def wake_order(central: LocalCentral) -> list[str]:
    """Return the order in which threads wake when all sleeps end together. Each of two modules has
    three threads and a timer.
    """
    order: list[str] = []

    def sleep(task: Task, number: int) -> None:
        task.sleep(1)
        order.append(f"{task.message} {number}")

    moves = {Module(name, central, capacity=3): Command(name, int) for name in ("legs", "arm")}
    legs, arm = moves
    for module, move in moves.items():
        module.handles(move)(sleep)
        module.every(1)(lambda name=module.name: order.append(f"tick {name}"))
    with legs.running(), arm.running(), connect("user", central) as user:
        for number in range(6):
            user.command(moves[legs if number % 2 else arm], number // 2, sequential=False)
        central.until_quiet()
        central.advance(1)
    return order


def test_simultaneous_sleeps_end_in_declared_order() -> None:
    for _ in range(20):
        with LocalCentral(stepped=True) as central:
            assert wake_order(central) == [
                "legs 0",
                "legs 1",
                "legs 2",
                "tick legs",
                "arm 0",
                "arm 1",
                "arm 2",
                "tick arm",
            ]


@pytest.mark.parametrize("is_killed", [False, True])
def test_coroutine_sleep_follows_stepped_clock(
    central: LocalCentral, user: Client, legs: Module, *, is_killed: bool
) -> None:
    seen: list[str] = []

    async def nap(task: Task, moment: float) -> None:
        try:
            await (task.sleep_until(moment) if moment > 50 else task.sleep(moment))
        finally:
            seen.append(f"{moment:g} {task.time():g}")

    @legs.handles(STEP)
    async def step(task: Task, number: int) -> None:
        await asyncio.gather(*(nap(task, moment) for moment in (100, 20, number)))

    with legs.running():
        sent = user.command(STEP, 10)
        central.advance(5)
        central.advance(94.5)
        assert seen == ["10 10", "20 20"]
        if is_killed:
            sent.kill()
        central.advance(0.5)
        assert sent.wait(SOON) is (Outcome.KILLED if is_killed else Outcome.DONE)
        assert seen[2:] == ["100 99.5" if is_killed else "100 100"]
