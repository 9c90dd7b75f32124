"""A handler receives requests of clients, accepts or rejects them, and reports intermediate
results.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import pytest
from module.real_central import SOON

from tca_module import (
    BASIC,
    GENERAL,
    BadData,
    Client,
    Command,
    Goal,
    LaterReply,
    LifeCycle,
    MisuseError,
    Module,
    Outcome,
    Party,
    Query,
    Rejected,
    Stopped,
    Task,
    TaskFailed,
    TaskKilled,
    Transition,
    ending,
)
from tca_module.testing import LocalCentral
from tca_wire.packets.changes import ChangeState


@dataclass
class Grip:
    item: str


GRASP = Command("grasp", Grip, result=str, progress=float)
HOLD, WALK, TALK = (
    Command("hold", Grip, result=str),
    Goal("walk", int),
    Command("talk", life_cycle=BASIC),
)
LOUDER = LifeCycle(
    "louder",
    [
        *GENERAL.transitions,
        Transition("louder", "running", "running", Party.CLIENT),
        Transition("pause", "running", "paused", Party.CLIENT),
        Transition("resumed", "paused", "running"),
        *ending("paused"),
    ],
)
SING = Command("sing", life_cycle=LOUDER)
FREE = Query("free", reply=bool)

STEPPED = True  # the tests step the clock of central


class Arm:
    """An arm that grasps until its task ends, and notes the requests that it receives."""

    def __init__(self, central: LocalCentral) -> None:
        self.requests_seen: list[str] = []
        self.module = Module("arm", central)
        self.module.handles(GRASP, accepts=True, takes=["update", "cancel"])(self.grasp)
        self.module.handles(HOLD, takes=["update", "cancel"], resource="hand")(self.hold)

    def grasp(self, task: Task, grip: Grip) -> str:
        if grip.item == "nothing":
            raise task.rejected("there is nothing to grasp")
        task.accept()
        task.report(0.5)
        while (request := task.wait_for_request(10)) is not None:
            self.requests_seen.append(f"{task.state}: {request.transition} {request.why}".strip())
            if request.transition == "cancel" and request.why:
                raise task.aborted("the hand is open")
            if request.transition == "cancel" or request.goal.item == "wall":
                request.reject("it can't be")
            else:
                request.accept()
                grip = request.goal
        return f"holds {grip.item}"

    async def hold(self, task: Task, grip: Grip) -> str:
        async for request in task.requests():
            self.requests_seen.append(f"{task.state}: {request.transition} {request.why}".strip())
            request.accept()
            if request.transition == "cancel":
                break
            grip = request.goal
        return f"held {grip.item}"


@pytest.fixture
def arm(central: LocalCentral) -> Iterator[Arm]:
    arm = Arm(central)
    with arm.module.running():
        yield arm


def test_handler_accepts_updates_and_completes_task(
    user: Client, arm: Arm, central: LocalCentral
) -> None:
    grasp = user.command(GRASP, Grip("pen"), delay=1)
    changes = grasp.changes()
    central.advance(1)
    grasp.update(Grip("cup"))
    assert grasp.state == "running"
    central.advance(10)
    assert grasp.result() == "holds cup"
    assert [(one.transition, one.state, one.goal.item) for one in changes] == [
        ("accepted", "running", "pen"),
        ("result available", "running", "pen"),
        ("update", "update requested", "pen"),
        ("accept", "running", "cup"),
        ("completed", "done", "cup"),
    ]
    assert arm.requests_seen == ["update requested: update"]


def test_handler_rejects_task_with_reason(user: Client, arm: Arm) -> None:
    grasp = user.command(GRASP, Grip("nothing"))
    with pytest.raises(TaskFailed, match="rejected: there is nothing to grasp") as failed:
        grasp.result()
    assert failed.value.failure == "rejected"
    assert grasp.state == "cancelled"


def test_handler_rejects_update_with_reason(user: Client, arm: Arm, central: LocalCentral) -> None:
    grasp = user.command(GRASP, Grip("pen"))
    central.until_quiet()
    with pytest.raises(
        Rejected, match=r"the update of command 'grasp' was rejected: it can't be"
    ) as rejected:
        grasp.update(Grip("wall"))
    assert rejected.value.reason == "it can't be"
    central.advance(10)
    assert grasp.result() == "holds pen"


def test_handler_accepts_update_with_changed_goal(user: Client, central: LocalCentral) -> None:
    arm = Module("arm", central)

    @arm.handles(HOLD, takes=["update", "cancel"])
    def hold(task: Task, grip: Grip) -> str:
        for request in task.requests():
            if request.transition == "cancel":
                with pytest.raises(MisuseError, match="has no goal: accept\\(\\) it without one"):
                    request.accept(grip)
                raise task.aborted()
            grip = Grip(f"{grip.item} and {request.goal.item}")
            request.accept(grip)
        return ""

    with arm.running():
        held = user.command(HOLD, Grip("cup"))
        central.until_quiet()
        held.update(Grip("spoon"))
        assert next(held.changes()).goal == Grip("cup and spoon")
        held.cancel()


def test_handler_refuses_or_grants_cancel(user: Client, arm: Arm, central: LocalCentral) -> None:
    grasp = user.command(GRASP, Grip("pen"))
    central.until_quiet()
    changes = grasp.changes()
    grasp.cancel()
    central.until_quiet()
    assert grasp.state == "running"
    grasp.cancel("the pen is hot")
    assert grasp.wait() is Outcome.KILLED
    seen = [
        (one.transition, one.state, one.text) for one in changes if one.transition and not one.data
    ]
    assert seen == [
        ("cancel", "cancel requested", ""),
        ("cancel failed", "running", "it can't be"),
        ("cancel", "cancel requested", "the pen is hot"),
        ("aborted", "cancelled", "the pen is hot (by user)"),
    ]


def test_cancel_before_acceptance_reaches_handler(
    user: Client, arm: Arm, central: LocalCentral
) -> None:
    grasp = user.command(GRASP, Grip("pen"))
    grasp.cancel("at once")  # before or after the handler has accepted it
    assert grasp.wait() is Outcome.KILLED
    assert arm.requests_seen == ["cancel requested: cancel at once"]


def test_handler_transition_precedes_unseen_request(user: Client, central: LocalCentral) -> None:
    feet = Module("feet", central)

    @feet.handles(WALK, accepts=True, takes=["cancel"])
    def walk(task: Task, _: int) -> None:
        task.sleep(1)
        task.accept()
        assert task.state == "cancel requested"
        task.sleep(1)

    with feet.running():
        walking = user.goal(WALK, 1)
        changes = walking.changes()
        central.until_quiet()
        walking.cancel()
        central.advance(2)
        seen = [(one.transition, one.by) for one in changes]
    assert seen == [
        ("cancel", "client"),
        ("accepted", "server"),
        ("cancel", "client"),
        ("completed", "server"),
    ]


def test_coroutine_receives_requests(user: Client, arm: Arm, central: LocalCentral) -> None:
    hold = user.command(HOLD, Grip("pen"))
    hold.update(Grip("cup"))
    hold.update(Grip("tea"))
    hold.cancel("enough")
    assert hold.wait() is Outcome.KILLED
    assert arm.requests_seen == [
        "update requested: update",
        "update requested: update",
        "cancel requested: cancel enough",
    ]
    killed = user.command(HOLD, Grip("pen"))
    central.until_quiet()
    killed.kill()
    assert killed.wait(SOON) is Outcome.KILLED


def test_request_wait_ends_with_task_or_module(
    user: Client, arm: Arm, central: LocalCentral
) -> None:
    feet, ends = Module("feet", central), list[str]()

    @feet.handles(WALK, takes=["update"])
    def walk(task: Task, _: int) -> None:
        try:
            task.wait_for_request()
        except (TaskKilled, Stopped) as error:
            ends.append(type(error).__name__)
            raise

    with feet.running():
        walking = user.goal(WALK, 1)
        central.until_quiet()
        walking.cancel()  # the handler does not receive requests
        assert walking.wait() is Outcome.KILLED
        user.goal(WALK, 2)
        central.until_quiet()
    assert ends == ["TaskKilled", "Stopped"]


def test_request_is_read_without_waiting(user: Client, central: LocalCentral) -> None:
    feet, seen = Module("feet", central), list[object]()

    @feet.handles(WALK, takes=["update", "cancel"])
    def walk(task: Task, _: int) -> None:
        seen.append(task.request)
        task.sleep(1)
        update = task.request
        assert update is not None
        assert update is task.request
        seen.append(str(update))
        task.sleep(1)
        cancel = task.request
        assert cancel is not None
        seen.append((update.is_open, update.accept(), update.reject(), str(cancel), cancel.is_open))
        assert cancel.accept()
        assert not cancel.is_open
        seen.append(task.request)

    with feet.running():
        walking = user.goal(WALK, 1)
        central.until_quiet()
        update = walking.update_send(2)
        central.advance(1)
        walking.cancel("no more")
        central.advance(1)
        with pytest.raises(Rejected, match="it was overtaken by a newer 'cancel'"):
            update.wait()
        assert walking.wait() is Outcome.KILLED
    cancel = "'cancel' of walk {1}: no more"
    assert seen == [None, "'update' of walk {1}", (False, False, False, cancel, True), None]


def test_refused_transitions_are_rejected_for_handler(user: Client, central: LocalCentral) -> None:
    feet = Module("feet", central)
    feet.handles(WALK, refuses=["update", "cancel"])(lambda task, _: task.sleep(10))
    with feet.running():
        walking = user.goal(WALK, 1)
        with pytest.raises(Rejected, match="the handler of 'walk' takes no 'update'"):
            walking.update(2)
        walking.cancel()
        central.until_quiet()
        assert walking.state == "running"
        central.advance(10)
        assert walking.wait() is Outcome.DONE


def test_handler_takes_custom_transitions(user: Client, central: LocalCentral) -> None:
    choir, requests_seen = Module("choir", central), list[str]()

    @choir.handles(SING, takes=["louder", "pause"])
    def sing(task: Task) -> None:
        task.sleep(1)
        while (request := task.wait_for_request(5)) is not None:
            requests_seen.append(f"{request.transition} while {task.state}")
            with pytest.raises(
                MisuseError, match=r"'\w+' of sing .* can't be rejected: life cycle 'louder' has no"
            ):
                request.reject()
            assert request.accept()
            if request.transition == "pause":
                task.take("resumed", "after a breath")

    with choir.running():
        singing = user.command(SING)
        changes = singing.changes()
        for name in ("louder", "louder", "pause"):
            assert singing.take(name)
        central.advance(6)
        assert singing.wait() is Outcome.DONE
        assert requests_seen == ["louder while paused", "louder while paused", "pause while paused"]
        assert [one.transition for one in changes][-3:] == ["pause", "resumed", "completed"]


NOT_POSSIBLE = [
    "walk {1} is 'running': 'accepted' is possible while it is 'initiated'; a task is accepted when its handler gets \
it, unless the handler is declared with accepts=True",
    "the handler of walk {1} can't take 'update': life cycle 'general' has for servers: 'accepted', 'already done', \
'rejected', 'accept', 'reject', 'aborted', 'cancel failed', 'result available', 'completed', 'failed'",
    "'failed' ends walk {1} as 'cancelled': raise Failure('failed')() instead",
    "walk {1} is 'running': 'accept' is possible while it is 'update requested'",
    "goal 'walk' is declared without progress=, and report() was given 1.5",
    "walk {1} is 'running', and no client has asked for its end: return, or fail",
    "grasp {2} is 'initiated': 'result available' is possible while it is 'running' or 'update requested' or \
'cancel requested'; accept() it first",
    "the intermediate results of command 'grasp' are float: Expected `float`, got `str`",
    "talk {3} can't report(): life cycle 'basic' has no transition for results",
    "'free' is no task of the tree: only goals and commands are",
    "'free' can't report(): only goals and commands have intermediate results",
]


def test_impossible_transition_in_handler_is_misuse(user: Client, central: LocalCentral) -> None:
    feet, errors = Module("feet", central), list[str]()

    def misuse(call: object) -> None:
        with pytest.raises((MisuseError, BadData)) as error:
            call()  # type: ignore[operator]
        errors.append(str(error.value))

    @feet.handles(WALK)
    def walk(task: Task, _: int) -> None:
        misuse(task.accept)
        misuse(lambda: task.take("update"))
        misuse(lambda: task.take("failed"))
        misuse(lambda: task.take("accept"))
        misuse(lambda: task.report(1.5))
        misuse(task.aborted)

    @feet.handles(GRASP, accepts=True)
    def grasp(task: Task, _: Grip) -> str:
        misuse(lambda: task.report(1.5))
        task.accept()
        misuse(lambda: task.report("firm"))
        return ""

    feet.handles(TALK)(lambda task: misuse(task.report))

    @feet.handles(FREE)
    def free(task: Task) -> bool:
        misuse(task.accept)
        misuse(task.report)
        return True

    with feet.running():
        user.goal(WALK, 1)
        user.command(GRASP, Grip("pen")).result()
        user.command(TALK).result()
        assert user.query(FREE)
    assert errors == NOT_POSSIBLE


def test_impossible_handles_options_are_misuse(central: LocalCentral) -> None:
    feet = Module("feet", central)
    with pytest.raises(
        MisuseError,
        match="goal 'walk' has no client's transition 'pause': life cycle 'general' has",
    ):
        feet.handles(WALK, takes=["pause"])
    with pytest.raises(
        MisuseError, match="goal 'walk' can't be handled with 'update' in both takes= and refuses="
    ):
        feet.handles(WALK, takes=["update"], refuses=["update"])
    with pytest.raises(
        MisuseError, match="query 'free' can't be handled with accepts=: only tasks have states"
    ):
        feet.handles(FREE, accepts=True)
    with pytest.raises(
        MisuseError, match=r"takes must be a list of transitions, such as .*, not 'update'"
    ):
        feet.handles(WALK, takes="update")
    with pytest.raises(
        MisuseError, match="goal 'walk' has no option take: the options are resource, pool, "
    ):
        feet.handles(WALK, take=["update"])  # type: ignore[call-overload]
    with pytest.raises(
        MisuseError, match="when_busy must be 'queue', 'preempt' or 'reject', or None, not 'wait'"
    ):
        feet.handles(WALK, when_busy="wait")  # type: ignore[call-overload]


def test_later_reply_reports_and_receives_requests(user: Client, central: LocalCentral) -> None:
    arm, owed = Module("arm", central), list[LaterReply[str]]()

    @arm.handles(GRASP, accepts=True, takes=["update"])
    def grasp(task: Task, _: Grip) -> LaterReply[str]:
        owed.append(task.reply_later())
        return owed[-1]

    with arm.running():
        grasping = user.command(GRASP, Grip("pen"))
        assert grasping.state == "initiated"
        central.until_quiet()
        (later,) = owed
        later.accept()
        later.report(0.7)
        central.until_quiet()
        assert (later.state, grasping.state, next(grasping.progress(float))) == (
            "running",
            "running",
            0.7,
        )
        update = grasping.update_send(Grip("cup"))
        central.until_quiet()
        request = later.request
        assert request is not None
        assert request.goal == Grip("cup")
        request.accept()
        update.wait(SOON)
        later.reply("held")
        assert grasping.result() == "held"
        with pytest.raises(
            MisuseError, match=r"grasp \{1\} has been answered already: accept\(\), report"
        ):
            later.report(0.8)


def test_undecodable_update_is_rejected_by_library(
    user: Client, arm: Arm, central: LocalCentral, caplog: pytest.LogCaptureFixture
) -> None:
    grasp = user.command(GRASP, Grip("pen"))
    central.until_quiet()
    changes = grasp.changes()
    link = user._connection()
    link.send_change(ChangeState(0, grasp.id, "update"), b"\x05", "the update")
    central.advance(10)
    assert grasp.result() == "holds pen"
    (rejected,) = (one.text for one in changes if one.transition == "reject")
    assert (
        rejected
        == "command 'grasp' came with data that is not of type Grip: Expected `object`, got `int`"
    )
    assert not arm.requests_seen
    assert "'update' of grasp {1} is rejected" in caplog.text


# --- Busy handlers --------------------------------------------------------------------------------


def test_busy_handler_rejects_or_is_preempted(user: Client, central: LocalCentral) -> None:
    feet, requests_seen = Module("feet", central), list[str]()
    feet.resource("mouth", when_busy="reject")
    feet.handles(TALK, resource="mouth")(lambda task: task.sleep(10))

    @feet.handles(WALK, takes=["cancel"], when_busy="preempt")
    def walk(task: Task, steps: int) -> None:
        if (request := task.wait_for_request(10)) is not None:
            requests_seen.append(f"{steps}: {request.why}")
            request.accept()

    with feet.running():
        talks = [user.command(TALK, sequential=False) for _ in range(2)]
        with pytest.raises(TaskFailed, match="rejected: mouth of feet is busy"):
            talks[1].result()
        walks = [user.goal(WALK, steps, sequential=False) for steps in (1, 2)]
        assert walks[0].wait() is Outcome.KILLED
        central.advance(10)
        assert (walks[1].wait(), talks[0].wait()) == (Outcome.DONE, Outcome.DONE)
        assert requests_seen == ["1: pre-empted by walk {4}"]
