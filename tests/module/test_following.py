"""The sender of a task follows its state, updates it and cancels it, even if its handler ignores
requests.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import pytest
from module.real_central import SOON

from tca_module import (
    BASIC,
    GENERAL,
    BadData,
    CentralLost,
    Change,
    Client,
    Command,
    Goal,
    LifeCycle,
    MisuseError,
    Module,
    Outcome,
    Party,
    Query,
    Refused,
    Rejected,
    Sender,
    SentTask,
    Task,
    TaskFailed,
    TaskKilled,
    Timeout,
    Transition,
    connect,
    ending,
)
from tca_module.following import observation
from tca_module.testing import LocalCentral


@dataclass
class Grip:
    item: str


@dataclass
class Feel:
    force: float


GRASP = Command("grasp", Grip, result=str, progress=Feel)
WAVE, WALK = Command("wave", int, life_cycle=BASIC), Goal("walk", int)
NEVER = Query("never", reply=int)
PAUSABLE = LifeCycle(
    "pausable",
    [
        *GENERAL.transitions,
        Transition("pause", "running", "paused", Party.CLIENT),
        Transition("resume", "paused", "running", Party.CLIENT),
        *ending("paused"),
    ],
)
CARRY = Command("carry", int, life_cycle=PAUSABLE)

STEPPED = True  # the tests step the clock of central


@pytest.fixture
def arm(central: LocalCentral) -> Iterator[Module]:
    """Run an arm whose handlers ignore states. It grasps everything at once, except a cup."""
    module = Module("arm", central)

    @module.handles(GRASP)
    def grasp(task: Task, grip: Grip) -> str:
        task.report(Feel(0.5))
        task.report(Feel(1.0))
        if grip.item == "cup":
            task.query(NEVER, timeout=None)
        return f"holds {grip.item}"

    module.handles(WAVE)(lambda task, _: task.sleep(10))
    module.handles(CARRY, takes=["pause", "resume"], resource="back")(
        lambda task, _: task.sleep(10)
    )
    module.handles(WALK, resource="legs")(lambda *_: None)
    with module.running():
        yield module


def raise_error(why: str) -> None:
    raise ValueError(why)


def transitions_of(changes: list[Change]) -> list[str]:
    return [f"{one.transition}: {one.state}" for one in changes]


def test_follower_sees_every_change_of_task(
    user: Client, arm: Module, central: LocalCentral
) -> None:
    grasp = user.command(GRASP, Grip("pen"), delay=5)
    assert (grasp.state, grasp.serial) == ("initiated", 0)
    changes = grasp.changes()
    central.advance(5)
    seen = list(changes)
    assert transitions_of(seen) == [
        "accepted: running",
        "result available: running",
        "result available: running",
        "completed: done",
    ]
    assert [one.serial for one in seen] == [1, 2, 3, 4]
    assert [one.by for one in seen] == ["server"] * 4
    assert [one.data for one in seen] == [None, Feel(0.5), Feel(1.0), "holds pen"]
    assert {one.goal.item for one in seen} == {"pen"}
    assert {one.module for one in seen[:3]} == {"arm"}
    assert not any(one.is_late or one.missed for one in seen)
    assert [one.is_over for one in seen] == [False, False, False, True]
    assert (grasp.state, grasp.serial, grasp.result()) == ("done", 4, "holds pen")
    assert {one.task.id for one in seen} == {grasp.id}


def test_only_first_state_read_asks_central(
    user: Client, arm: Module, central: LocalCentral
) -> None:
    grasp = user.command(GRASP, Grip("pen"), delay=5)
    assert grasp.state == "initiated"
    before = len(central.entries)
    assert [grasp.state for _ in range(5)] == ["initiated"] * 5
    assert len(central.entries) == before


def test_next_change_waits_for_change(user: Client, arm: Module, central: LocalCentral) -> None:
    wave = user.command(WAVE, 1, delay=5)
    wave.follow()
    with pytest.raises(Timeout, match=r"a change of command .wave. did not come within 0\.01 s"):
        wave.next_change(0.01)
    central.advance(15)
    assert [str(wave.next_change()) for _ in range(3)] == [
        "wave {1}: running (accepted)",
        "wave {1}: done (completed)",
        "None",
    ]
    assert wave.next_change() is None


def test_wait_for_state_returns_at_state_or_end(
    user: Client, arm: Module, central: LocalCentral
) -> None:
    wave = user.command(WAVE, 1, delay=5)
    assert wave.wait_for_state("initiated") == "initiated"
    with pytest.raises(
        Timeout, match=r"command 'wave' was not running or done within 0\.01 s, but is initiated"
    ):
        wave.wait_for_state("running", "done", timeout=0.01)
    central.advance(5)
    assert wave.wait_for_state("running") == "running"
    central.advance(10)
    assert wave.wait_for_state("running") == "done", "the task has ended"
    with pytest.raises(
        MisuseError,
        match="is never 'paused': life cycle 'basic' has 'initiated', 'running', 'done'",
    ):
        wave.wait_for_state("paused")
    with pytest.raises(MisuseError, match=r'give one or more states, such as "running", not \(\)'):
        wave.wait_for_state()
    with pytest.raises(MisuseError, match="give one or more states"):
        wave.wait_for_state(5)  # type: ignore[arg-type]


def test_late_follower_gets_current_state(user: Client, arm: Module, central: LocalCentral) -> None:
    user.command(GRASP, Grip("cup"))
    central.until_quiet()
    with connect("visitor", central) as visitor:
        (found,) = visitor.tasks(GRASP)
        late = found.next_change()
        assert late is not None
        assert (late.state, late.serial, late.is_late, late.missed, late.transition) == (
            "running",
            3,
            True,
            0,
            "",
        )
        assert (late.goal, late.data) == ({"item": "cup"}, {"force": 1.0}), (
            "an undeclared message has plain values"
        )
        assert next(found.progress()) == {"force": 1.0}
        found.kill("enough")
        last = found.next_change()
        assert last is not None
        assert (last.state, last.text, last.by) == ("cancelled", "enough (by visitor)", "central")


def test_changes_of_followed_task_begin_with_current_state(
    user: Client, arm: Module, central: LocalCentral
) -> None:
    grasp = user.command(GRASP, Grip("cup"), delay=5)
    grasp.follow()
    central.advance(5)
    late = next(grasp.changes())
    assert (late.state, late.serial, late.is_late, late.transition, late.by) == (
        "running",
        3,
        True,
        "",
        "central",
    )
    assert late.data == Feel(1.0)
    assert late.missed == 2, "earlier changes since following began"


def test_final_state_is_known_after_end(user: Client, arm: Module, central: LocalCentral) -> None:
    grasp, dropped = user.command(GRASP, Grip("pen")), user.command(GRASP, Grip("cup"))
    central.until_quiet()
    dropped.kill()
    central.until_quiet()
    assert (grasp.state, dropped.state) == ("done", "cancelled")
    (only,) = grasp.changes()
    assert (only.state, only.is_over, only.is_late, only.data) == ("done", True, True, "holds pen")
    assert grasp.next_change() is None


def test_progress_yields_intermediate_results(user: Client, arm: Module) -> None:
    grasp = user.command(GRASP, Grip("pen"))
    grasp.follow()
    assert [feel.force for feel in grasp.progress(Feel)][-1:] == [1.0]
    with pytest.raises(
        MisuseError,
        match="the intermediate results of command 'grasp' are Feel, not <class 'float'>",
    ):
        grasp.progress(float)


def test_progress_has_declared_generic_type(user: Client, legs: Module) -> None:
    count = Command("count", progress=list[int])
    legs.handles(count)(lambda task: task.report([1, 2]))
    with legs.running():
        sent = user.command(count, suspended=True)
        counted = sent.progress(list[int], timeout=SOON)
        sent.resume()
        assert next(counted) == [1, 2]


def test_on_change_function_gets_each_change(
    user: Client, arm: Module, central: LocalCentral
) -> None:
    seen: list[str] = []
    wave = user.command(WAVE, 1, delay=5)

    def record(sender: Sender, change: Change) -> None:
        seen.append(change.state)
        if change.is_over:
            sender.command(WAVE, 2)

    wave.on_change(record)
    wave.on_change(lambda change: seen.append(str(change.serial)))
    never = wave.on_change(lambda _: seen.append("never"))
    never.cancel()
    central.advance(15)
    assert wave.wait() is Outcome.DONE
    with pytest.raises(Timeout):
        user.tasks(WAVE)[0].wait(0.01)
    assert seen == ["running", "1", "done", "2"]


def test_error_in_on_change_function_is_logged(
    user: Client, arm: Module, central: LocalCentral, caplog: pytest.LogCaptureFixture
) -> None:
    grasp = user.command(GRASP, Grip("pen"), delay=1)
    grasp.on_change(lambda _: raise_error("seen"))
    central.advance(1)
    assert grasp.wait() is Outcome.DONE
    assert "ValueError: seen" in caplog.text
    with pytest.raises(
        MisuseError, match=r"on_change\(\): .* declare it with \(sender, change\) or \(change\)"
    ):
        grasp.on_change(lambda: None)  # type: ignore[arg-type, misc]


def record_and_cancel(seen: list[str], change: Change) -> None:
    """Record a change, and cancel the task. The caller waits for this task meanwhile."""
    seen.append(change.state)
    if change.state == "running":
        change.task.cancel()


def after_result(sent: SentTask[None]) -> None:
    with pytest.raises(TaskKilled):
        sent.result(SOON)


async def after_await(sent: SentTask[None]) -> None:
    with pytest.raises(TaskKilled):
        await sent


@pytest.mark.parametrize(
    "await_end",
    [
        after_result,
        lambda sent: sent.wait(SOON),
        lambda sent: sent.wait_for_state("cancelled", timeout=SOON),
        lambda sent: list(sent.changes(SOON)),
        lambda sent: [sent.next_change(SOON) for _ in range(3)],
    ],
    ids=["result", "wait", "wait_for_state", "changes", "next_change"],
)
def test_on_change_sees_end_before_waiter_returns(
    user: Client, arm: Module, await_end: Callable[[SentTask[None]], object]
) -> None:
    seen: list[str] = []
    carry = user.command(CARRY, 1)
    carry.on_change(partial(record_and_cancel, seen))
    await_end(carry)
    assert seen == ["running", "cancel requested", "cancelled"]


def test_on_change_sees_end_before_awaiting_coroutine(
    user: Client, arm: Module, central: LocalCentral
) -> None:
    brain, seen = Module("brain", central), list[str]()

    @brain.handles(WALK)
    async def think(task: Task, _: int) -> None:
        carry = task.command(CARRY, 1)
        carry.on_change(partial(record_and_cancel, seen))
        await after_await(carry)
        seen.append("goes on")

    with brain.running():
        assert user.goal(WALK, 1).wait(SOON) is Outcome.DONE
    assert seen == ["running", "cancel requested", "cancelled", "goes on"]


def test_on_change_sees_end_before_connection_closes(
    user: Client, arm: Module, central: LocalCentral
) -> None:
    seen, idle_module = list[str](), Module("nobody", central)
    for connection in (connect("visitor", central), idle_module.running()):
        with connection as sender:

            def record(sender: Sender, change: Change) -> None:
                seen.append(change.state)
                if change.is_over:
                    sender.command(WAVE, 1, delay=100)

            sender.command(GRASP, Grip("cup"), delay=100).on_change(record)
            sender.tasks(GRASP)[0].cancel()
        assert seen.pop() == "cancelled"
    central.until_quiet()
    assert len(user.tasks(WAVE)) == 2, "the function could still send"


# --- Updates and cancels --------------------------------------------------------------------------


def test_update_restarts_handler_that_takes_none(
    user: Client, arm: Module, central: LocalCentral
) -> None:
    grasp = user.command(GRASP, Grip("cup"))
    changes = grasp.changes()
    central.until_quiet()
    grasp.update(Grip("pen"))
    assert grasp.result() == "holds pen"
    seen = transitions_of([one for one in changes if one.transition != "result available"])
    assert seen == [
        ": running",
        "update: update requested",
        "accept: running",
        "restarted: initiated",
        "accepted: running",
        "completed: done",
    ]


def test_cancel_kills_task_whose_handler_takes_none(
    user: Client, arm: Module, central: LocalCentral
) -> None:
    grasp = user.command(GRASP, Grip("cup"))
    grasp.cancel("the cup is hot")
    assert grasp.wait() is Outcome.KILLED
    assert grasp.state == "cancelled"
    grasp.cancel()  # cancelling again does no harm
    queued = user.command(GRASP, Grip("cup"), delay=60)
    queued.cancel()
    assert queued.wait() is Outcome.KILLED


def test_cancel_survives_connection_break(user: Client, arm: Module, central: LocalCentral) -> None:
    grasp = user.command(GRASP, Grip("cup"))
    assert grasp.state == "running"
    central.cut("user")
    grasp.cancel("nobody hears me")
    assert grasp.wait(SOON) is Outcome.KILLED
    assert grasp.state == "cancelled"


def test_cancel_right_before_program_end_arrives(arm: Module, central: LocalCentral) -> None:
    with connect("hasty", central) as hasty:
        hasty.command(GRASP, Grip("cup"))
    with connect("hasty", central) as hasty:
        hasty.tasks(GRASP)[0].cancel("no time")
    central.until_quiet()
    assert not central.core.dispatcher.running
    assert "killed: grasp {1}: no time (by hasty)" in central.transcript()


def test_impossible_update_is_refused_with_reason(
    user: Client, arm: Module, central: LocalCentral
) -> None:
    grasp = user.command(GRASP, Grip("pen"), delay=5)
    with pytest.raises(
        Refused, match="the task is 'initiated', and that is possible while it is 'running' or"
    ):
        grasp.update(Grip("cup"))
    with pytest.raises(BadData, match="wants data of type Grip"):
        grasp.update(5)
    central.advance(5)
    with pytest.raises(Rejected, match="it came too late, the task is done") as error:
        grasp.update(Grip("cup"))
    assert error.value.reason == "it came too late, the task is done"


def test_life_cycle_without_update_or_cancel_refuses_both(user: Client, arm: Module) -> None:
    wave = user.command(WAVE, 1)
    with pytest.raises(MisuseError, match=r"life cycle 'basic' has no updates"):
        wave.update(2)
    with pytest.raises(
        MisuseError, match=r"life cycle 'basic' has no such transition; kill\(\) ends the task"
    ):
        wave.cancel()
    wave.kill()


def test_found_task_is_updated_only_with_its_message(
    user: Client, arm: Module, central: LocalCentral
) -> None:
    grasp = user.command(GRASP, Grip("cup"))
    central.until_quiet()
    with connect("visitor", central) as visitor:
        (found,) = visitor.tasks("grasp")
        with pytest.raises(
            MisuseError, match=r"a new goal of .*: name the task's message, with message="
        ):
            found.update({"item": "pen"})
        with pytest.raises(MisuseError, match=r"grasp \{1\} is no 'wave'"):
            found.update(2, message=WAVE)
        found.update(Grip("pen"), message=GRASP)
    assert grasp.result() == "holds pen"


def test_client_takes_custom_transition(user: Client, arm: Module, central: LocalCentral) -> None:
    carry = user.command(CARRY, 1)
    assert carry.state == "running"
    assert carry.take("pause", why="a step ahead")
    assert carry.state == "paused"
    with pytest.raises(
        Refused, match="the task is 'paused', and that is possible while it is 'running'"
    ):
        carry.take("pause")
    with pytest.raises(
        MisuseError,
        match="no client can take that; life cycle 'pausable' has for clients: 'update', ",
    ):
        carry.take("accept")
    assert carry.take("resume")
    central.advance(10)
    assert carry.state == "done"
    assert not carry.take("cancel"), "the task has ended"


# --- Breaks and lost changes ----------------------------------------------------------------------


def test_following_continues_after_break(user: Client, arm: Module, central: LocalCentral) -> None:
    wave = user.command(WAVE, 1, delay=5)
    changes = wave.changes()
    assert wave.state == "initiated"
    central.cut("user")
    central.advance(5)
    assert next(changes).state == "running"
    central.cut("user")
    central.advance(10)
    assert [one.state for one in changes] == ["done"]


def test_unread_changes_are_counted_as_missed(
    user: Client, arm: Module, monkeypatch: pytest.MonkeyPatch, central: LocalCentral
) -> None:
    monkeypatch.setattr(observation, "MOST_UNREAD", 2)
    grasp = user.command(GRASP, Grip("pen"), delay=5)
    changes = grasp.changes()
    central.advance(5)
    seen = [(one.serial, one.missed) for one in changes]
    assert seen == [(3, 2), (4, 0)]


def test_task_lost_with_central_raises_on_next_change(
    user: Client, arm: Module, central: LocalCentral
) -> None:
    wave = user.command(WAVE, 1, delay=60)
    assert wave.state == "initiated"
    central.restart("second")
    with pytest.raises(CentralLost, match="command 'wave' is lost: central was restarted"):
        wave.next_change(SOON)


def test_failed_task_ends_in_state_cancelled(
    user: Client, arm: Module, central: LocalCentral
) -> None:
    fail = Command("fail")
    feet = Module("feet", central)
    feet.handles(fail)(lambda _: raise_error("no ground"))
    with feet.running():
        failing = user.command(fail, delay=1)
        changes = failing.changes()
        central.advance(1)
        assert transitions_of(list(changes)) == ["accepted: running", "failed: cancelled"]
        with pytest.raises(TaskFailed):
            failing.result()
