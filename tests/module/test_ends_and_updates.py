"""A task ends in one of several states that its life cycle declares. Updates overtake each other."""

import pytest

from tca_module import (
    GENERAL,
    ONE_UPDATE,
    ROS_GOAL,
    Client,
    Command,
    Effect,
    LaterReply,
    LifeCycle,
    MisuseError,
    Module,
    Outcome,
    Refused,
    Rejected,
    Task,
    TaskFailed,
    Transition,
    connect,
)
from tca_module.testing import LocalCentral

STEPPED = True  # the tests step the clock of central
LOOKING = LifeCycle(
    "looking",
    [*GENERAL.transitions, Transition("see nothing", "running", "nothing seen")],
    done=["done", "nothing seen"],
)
LOOK = Command("look", int, result=str, life_cycle=LOOKING)


def test_handler_names_its_end(user: Client, central: LocalCentral) -> None:
    eye = Module("eye", central)

    @eye.handles(LOOK)
    def look(task: Task, angle: int) -> str | LaterReply[str]:
        if angle:
            task.take("see nothing")
            task.take("see nothing")
            with pytest.raises(MisuseError, match="'see nothing' already ends"):
                task.take("completed")
        if angle == 2:
            later = task.reply_later()
            later.reply("dark")
            return later
        return "bright"

    with eye.running():
        looks = [user.command(LOOK, angle) for angle in range(3)]
        found = [(look.result(), look.state) for look in looks]
        looking = user.command(LOOK, 1, suspended=True)
        seen = looking.changes()
        looking.resume()
        changes = [list(seen)[-1]]
    ends = [("bright", "done"), ("bright", "nothing seen"), ("dark", "nothing seen")]
    assert found == ends
    assert [(one.transition, one.outcome, one.data) for one in changes] == [
        ("see nothing", Outcome.DONE, "bright")
    ]


def test_ros_goal_reports_feedback(user: Client, central: LocalCentral) -> None:
    eye = Module("eye", central)
    scan = Command("scan", int, result=str, progress=float, life_cycle=ROS_GOAL)

    @eye.handles(scan)
    def looks_around(task: Task, _: int) -> str:
        task.report(0.5)
        return "bright"

    sent = user.command(scan, 1)
    sent.follow()
    with eye.running():
        assert list(sent.progress(float)) == [0.5]
        assert (sent.result(), sent.state) == ("bright", "succeeded")


@pytest.mark.parametrize(("takes", "refuses"), [(["cancel_goal"], []), ([], ["cancel_goal"])])
def test_ros_goal_continues_after_a_rejected_cancel(
    user: Client, central: LocalCentral, takes: list[str], refuses: list[str]
) -> None:
    do, hand = Command("do", life_cycle=ROS_GOAL), Module("hand", central)

    @hand.handles(do, takes=takes, refuses=refuses)
    def handle(task: Task) -> None:
        if takes:
            task.wait_for_request().reject("cannot stop now")
        task.sleep(1)

    with hand.running():
        sent = user.command(do)
        central.until_quiet()
        assert sent.state == "executing"
        changes = sent.changes()
        sent.cancel()
        central.advance(1)
        assert [one.state for one in changes] == [
            "executing",
            "canceling",
            "executing",
            "succeeded",
        ]


def test_impossible_rejection_names_the_remedy(user: Client, central: LocalCentral) -> None:
    rows = [row for row in GENERAL.transitions if row.effect is not Effect.REFUSE]
    do, hand = Command("do", life_cycle=LifeCycle("blunt", rows)), Module("hand", central)

    @hand.handles(do, takes=["cancel"])
    def handle(task: Task) -> None:
        task.wait_for_request().reject()

    with hand.running():
        sent = user.command(do)
        central.until_quiet()
        sent.cancel()
        with pytest.raises(TaskFailed, match=r"effect=Effect\.REFUSE"):
            sent.result()
    refuser = Module("refuser", central)
    refuser.handles(do, refuses=["cancel"])(lambda _: None)
    with pytest.raises(Refused, match=r"effect=Effect\.REFUSE"), refuser.running():
        pass


def test_take_of_a_failing_end_is_misuse(user: Client, central: LocalCentral) -> None:
    do, errors = Command("do", life_cycle=ROS_GOAL), list[str]()
    hand = Module("hand", central)

    @hand.handles(do)
    def handle(task: Task) -> None:
        with pytest.raises(MisuseError) as error:
            task.take("abort")
        errors.append(str(error.value))

    with hand.running():
        user.command(do).result()
    assert errors == ["'abort' ends do {1} as 'aborted': raise Failure('abort')() instead"]


@pytest.mark.parametrize("answers_first", [False, True])
def test_newest_update_wins_and_older_says_why(
    user: Client, central: LocalCentral, answers_first: bool
) -> None:
    eye, go = Module("eye", central), Command("go", int, result=int)

    @eye.handles(go, takes=["update"])
    def handle(task: Task, goal: int) -> int:
        while goal < 3:
            task.sleep(1)
            if answers_first or (task.request is not None and task.request.goal == 3):
                request = task.wait_for_request()
                request.accept()
                goal = request.goal
        return goal

    with eye.running(), connect("other", central) as other:
        going = user.command(go, 1)
        central.until_quiet()
        older = going.update_send(2)
        if answers_first:
            central.advance(1)
        found = other.task(going.id)
        assert found is not None
        newer = found.update_send(3, message=go)
        central.advance(1)
        newer.wait()
        if answers_first:
            older.wait()
        else:
            with pytest.raises(Rejected, match="it was overtaken by a newer 'update'"):
                older.wait()
        assert going.result() == 3


def test_oldest_update_wins_by_option(user: Client, central: LocalCentral) -> None:
    eye, go = Module("eye", central), Command("go", int, life_cycle=ONE_UPDATE)

    @eye.handles(go, takes=["update"])
    def handle(task: Task, _: int) -> None:
        task.sleep(1)
        task.wait_for_request().accept()

    with eye.running():
        going = user.command(go, 1)
        going.wait_for_state("running")
        older = going.update_send(2)
        going.wait_for_state("update requested")
        with pytest.raises(Refused, match="another 'update' is pending"):
            going.update(3)
        central.advance(1)
        older.wait()
