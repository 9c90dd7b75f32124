"""Any program can observe the states of tasks. Neither the senders nor the handlers of these tasks
know of it.
"""

import asyncio
import threading
from collections.abc import Iterator

import pytest
from module.real_central import SOON

from tca_module import (
    BASIC,
    Change,
    Client,
    Command,
    Goal,
    Inform,
    MisuseError,
    Module,
    NotSent,
    Outcome,
    Refused,
    Rejected,
    Sender,
    Task,
    Timeout,
    connect,
)
from tca_module.testing import LocalCentral

GRASP, WAVE, WALK = (
    Command("grasp", str, progress=float),
    Command("wave", life_cycle=BASIC),
    Goal("walk", int),
)
GAZE = Inform("gaze", str)

STEPPED = True  # the tests step the clock of central


@pytest.fixture
def visitor(central: LocalCentral) -> Iterator[Client]:
    with connect("visitor", central) as client:
        yield client


@pytest.fixture
def arm(central: LocalCentral) -> Iterator[Module]:
    """Run an arm that grasps a thing for ten seconds, waves for one second, and walks by waving."""
    module = Module("arm", central)

    @module.handles(GRASP, takes=["update"])
    def grasp(task: Task, thing: str) -> None:
        task.report(0.5)
        while (request := task.wait_for_request(10)) is not None:
            request.accept() if request.goal != "wall" else request.reject("too big")

    @module.handles(WALK, resource="legs")
    def walk(task: Task, steps: int) -> None:
        for _ in range(steps):
            task.command(WAVE)

    module.handles(WAVE, resource="hand")(lambda task: task.sleep(1))
    with module.running():
        yield module


def described(changes: list[Change]) -> list[str]:
    return [f"{one.task}: {one.state}" + " (late)" * one.is_late for one in changes]


def test_observer_sees_all_tasks_of_message(
    user: Client, visitor: Client, arm: Module, central: LocalCentral
) -> None:
    early = user.command(GRASP, "pen")
    central.until_quiet()
    with visitor.observe(GRASP) as changes:
        late = changes.receive()
        assert late is not None
        assert (late.state, late.is_late, late.goal, late.data, late.serial) == (
            "running",
            True,
            "pen",
            0.5,
            2,
        )
        user.command(WAVE)
        later = user.command(GRASP, "cup")
        early.update("tea")
        central.advance(25)
        seen = changes.arrived()
    assert described(seen) == [
        "grasp {3}: initiated",
        "grasp {1}: update requested",
        "grasp {1}: running",
        "grasp {1}: done",
        "grasp {3}: running",
        "grasp {3}: running",
        "grasp {3}: done",
    ]
    assert [one.goal for one in seen[:3]] == ["cup", "pen", "tea"]
    assert not any(one.missed for one in seen)
    assert later.wait() is Outcome.DONE


def test_observer_sees_all_tasks_or_one_subtree(
    user: Client, visitor: Client, arm: Module, central: LocalCentral
) -> None:
    everything = visitor.observe()
    walk = user.goal(WALK, 2)
    central.until_quiet()
    (seen_by_visitor,) = visitor.tasks(WALK)
    below = visitor.observe(below=seen_by_visitor, states=["running", "done"])
    central.advance(2)
    assert walk.wait() is Outcome.DONE
    assert described(below.arrived()) == [
        "wave {2}: running (late)",
        "wave {2}: done",
        "wave {3}: running",
        "wave {3}: done",
    ]
    assert {one.message for one in everything.arrived()} == {"walk", "wave"}
    everything.close()
    everything.close()
    user.command(WAVE)
    assert everything.arrived() == []
    assert next(everything, None) is None


def test_observing_function_of_module_is_called(
    user: Client, arm: Module, central: LocalCentral
) -> None:
    head, seen = Module("head", central), list[str]()

    @head.observes(GRASP, states=["running"])
    def inform_gaze(sender: Sender, change: Change) -> None:
        sender.inform(GAZE, change.goal)

    @head.observes(WAVE)
    def record(change: Change) -> None:
        seen.append(str(change))

    head.handles(GAZE)(lambda _, thing: seen.append(f"looks at {thing}"))
    early = user.command(GRASP, "pen")
    central.until_quiet()
    with head.running():
        central.until_quiet()
        assert seen == ["looks at pen"]
        user.command(WAVE)
        central.advance(10)
        central.advance(1)
        assert early.wait() is Outcome.DONE
    assert seen[1:] == [
        "wave {3}: initiated (initiated)",
        "wave {3}: running (accepted)",
        "wave {3}: done (completed)",
    ]


def test_observer_learns_missed_end_after_reconnect(
    user: Client, visitor: Client, arm: Module, central: LocalCentral
) -> None:
    changes = visitor.observe(WAVE)
    wave = user.command(WAVE)
    central.until_quiet()
    assert [one.state for one in changes.arrived()] == ["initiated", "running"]
    central.cut("visitor")
    central.advance(1)
    assert wave.wait() is Outcome.DONE
    last = changes.receive(SOON)
    assert last is not None
    assert (last.state, last.is_over, last.missed, last.text) == (
        "",
        True,
        1,
        "it ended while this program did not hear central",
    )


def test_observing_continues_after_central_restart(
    visitor: Client, arm: Module, central: LocalCentral, short_timeouts: None
) -> None:
    changes = visitor.observe(GRASP)
    user = connect("user", central)
    user.command(GRASP, "pen", delay=60)
    assert [one.state for one in changes.arrived()] == ["initiated"]
    central.restart("second")
    lost = changes.receive(SOON)
    assert lost is not None
    assert (lost.is_over, lost.text) == (True, "central was restarted and has forgotten it")
    with connect("another", central) as another:
        another.command(GRASP, "cup", delay=60)
        again = changes.receive(SOON)
        assert again is not None
        assert (again.state, again.goal, again.missed) == ("initiated", "cup", 0)
    with pytest.raises(NotSent):
        user.close()


def test_impossible_observation_is_misuse_or_times_out(
    visitor: Client, central: LocalCentral
) -> None:
    with pytest.raises(
        MisuseError, match=r"observe\(\): command 'wave' is never 'paused': life cycle 'basic' has"
    ):
        visitor.observe(WAVE, states=["paused"])
    with pytest.raises(
        MisuseError, match=r"observes\(\): .* declare it with \(sender, change\) or \(change\)"
    ):
        Module("head", central).observes(WAVE)(lambda: None)  # type: ignore[type-var]
    nothing = visitor.observe("never heard of", timeout=0.01)
    with pytest.raises(Timeout, match=r"a change of state did not come within 0\.01 s"):
        next(nothing)


def test_closed_change_stream_yields_nothing(
    visitor: Client, user: Client, arm: Module, central: LocalCentral
) -> None:
    wave = user.command(WAVE, delay=1)
    changes = wave.changes()
    with changes:
        central.advance(1)
        assert next(changes).state == "running"
    central.advance(1)
    assert list(changes) == changes.arrived() == []
    assert wave.state == "done"


def test_refused_observation_raises_and_is_logged(
    user: Client,
    arm: Module,
    central: LocalCentral,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    user.command(WAVE, delay=60)
    monkeypatch.setattr("tca_central.life_cycles.observing.MOST_SEARCHED", 0)
    with pytest.raises(Refused, match="the states of tasks was refused: there are 1 tasks"):
        next(user.observe())
    with pytest.raises(Refused, match="there are 1 tasks"):
        user.observe().arrived()
    head = Module("head", central)
    head.observes()(print)
    with head.running():
        central.until_quiet()
    assert "observing all tasks was refused: there are 1 tasks: observe a message" in caplog.text
    assert "no function is called with these changes any more" in caplog.text


# --- In coroutines --------------------------------------------------------------------------------


def test_coroutines_follow_and_observe(user: Client, arm: Module, central: LocalCentral) -> None:
    brain, seen, plan = Module("brain", central), list[object](), Goal("plan")

    @brain.handles(plan)
    async def do_plan(task: Task) -> None:
        grasp = task.command(GRASP, "pen")
        progress = grasp.progress(float)
        seen.append(await anext(progress))
        await grasp.update_send("cup")
        with pytest.raises(Rejected, match="too big"):
            await grasp.update_send("wall")
        async for change in grasp.changes():
            seen.append(change.state)
        async with asyncio.timeout(SOON), asyncio.TaskGroup() as group:
            group.create_task(watch(task))
            await asyncio.sleep(0)
            await task.command(WAVE)

    async def watch(task: Task) -> None:
        with task.observe(WAVE) as changes:
            async for change in changes:
                seen.append(f"wave: {change.state}")
                if change.is_over:
                    return

    with brain.running():
        planning = user.goal(plan)
        central.until_quiet()
        central.advance(10)
        central.advance(1)
        assert planning.wait(SOON) is Outcome.DONE
    assert seen[:3] == [0.5, "running", "done"]
    assert seen[-1] == "wave: done"


def test_timed_out_coroutine_misses_no_change(
    user: Client, arm: Module, central: LocalCentral
) -> None:
    brain, seen, plan = Module("brain", central), list[tuple[str, int]](), Goal("plan")
    has_lost_patience = threading.Event()

    @brain.handles(plan)
    async def do_plan(task: Task) -> None:
        wave = task.command(WAVE, delay=5)
        changes = wave.changes()
        for _ in range(3):
            with pytest.raises(TimeoutError):
                async with asyncio.timeout(0.01):
                    await anext(changes)
        has_lost_patience.set()
        async for change in changes:
            seen.append((change.state, change.missed))

    with brain.running():
        planning = user.goal(plan)
        assert has_lost_patience.wait(SOON)
        assert central.core.observers.count == 1
        central.advance(6)
        assert planning.wait(SOON) is Outcome.DONE
    assert seen == [("running", 0), ("done", 0)]


# --- Cancelling all -------------------------------------------------------------------------------


def test_cancel_all_cancels_only_own_tasks(
    user: Client, visitor: Client, arm: Module, central: LocalCentral
) -> None:
    others = visitor.command(GRASP, "tea", delay=60)
    old = user.command(GRASP, "pen", delay=60)
    walk = user.goal(WALK, 1, delay=60)
    central.advance(5)
    moment = user.time()
    central.advance(5)
    new = [user.command(GRASP, thing, sequential=False, delay=60) for thing in ("cup", "mug")]
    wave = user.command(WAVE, delay=60, sequential=False)
    assert user.cancel_all(GRASP, before=moment, why="too late") == 1
    assert old.wait() is Outcome.KILLED
    assert user.cancel_all(GRASP) == 2
    assert [one.wait() for one in new] == [Outcome.KILLED] * 2
    assert user.cancel_all() == 1, "waves can't be cancelled"
    assert walk.wait() is Outcome.KILLED
    assert user.cancel_all() == 0
    assert (others.state, wave.state) == ("initiated", "initiated")
    assert central.transcript().count("too late") == 2
