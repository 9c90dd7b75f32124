"""What is wrong in a call is said where it is written, before anything leaves: what, which, and what it must be.

Whether each call refuses what is hostile is test_hostile_calls.py's matter; here is what people read.
"""

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tca_module import (
    BadData,
    Broadcast,
    Client,
    Command,
    Condition,
    DemonMonitor,
    ExceptionHandler,
    Failure,
    Goal,
    Inform,
    LaterReply,
    MisuseError,
    Module,
    MultiQuery,
    PointMonitor,
    PollingMonitor,
    Query,
    Task,
    Variable,
    connect,
    this,
)

SOON = 5.0
REST, WALK, SAY, HI = Command("rest"), Goal("walk", float), Inform("say", str), Broadcast("hi")
WHERE, ALL, FREE = Query("where", reply=float), MultiQuery("all", reply=int), Query("free", reply=bool)
HEAT, SLIPPED, FELL = Variable("heat", float), Failure("slipped", float), Failure("fell")
GRIP, SHRUG = ExceptionHandler("grip", float), ExceptionHandler("shrug")
LOOK, POLL = PointMonitor("look", condition=FREE), PollingMonitor("poll", condition=FREE)
ROCKS, BLIND = DemonMonitor("rocks", action=REST), DemonMonitor("blind")


async def coming(_sender: Any, _reply: float) -> None: ...


def two(_first: Any, _second: Any) -> None: ...


Call = Callable[[Any, Any, Any], object]

CALLS: list[Call] = [
    lambda user, _task, _: user.query(WALK),
    lambda user, _task, _: user.goal(WHERE),
    lambda user, _task, _: user.inform(HI),
    lambda user, _task, _: user.broadcast("hi"),
    lambda user, _task, _: user.execute(POLL),
    lambda user, _task, _: user.tap(Condition.WHEN_SENT, "rest", REST),
    lambda user, _task, _: user.command(REST, 5),
    lambda user, _task, _: user.command(REST, planfirst=True),
    lambda user, _task, _: user.goal(WALK, 1.0, plan_first=1),
    lambda user, _task, _: user.command(REST, deadline=0),
    lambda user, _task, _: user.command(REST, delay=-1),
    lambda user, _task, _: user.command(REST, priority=2.5),
    lambda user, task, _: user.command(REST, constraints=task.achieving.end <= this.achieving.start),
    lambda user, _task, _: user.command(REST, on_failure=(SLIPPED, SHRUG)),
    lambda user, _task, _: user.query(WHERE, timeout=float("nan")),
    lambda user, _task, _: user.multi_query(ALL, maximum=0),
    lambda user, _task, _: user.query_notify(WHERE, None, coming),
    lambda user, _task, _: user.query_notify(WHERE, None, lambda reply: reply),
    lambda user, _task, _: user.wait_until_handled("rest"),
    lambda user, _task, _: user.sequence(-1).__enter__(),
    lambda user, _task, _: user.constrain("soon"),
    lambda user, _task, _: user.under(5),
    lambda user, _task, _: user.task(-1),
    lambda user, _task, _: user.tasks(5),
    lambda user, _task, _: user.set_variable(SAY, "x"),
    lambda user, _task, _: user.lock("arm", 5),
    lambda user, _task, _: user.unlock(" "),
    lambda user, _task, _: user.status("soon"),
    lambda user, _task, _: user.tap("befor handling", REST, SAY),
    lambda user, _task, _: user.tap(Condition.WHEN_SENT, REST, SAY, period=1),
    lambda user, _task, _: user.monitor(REST),
    lambda user, _task, _: user.monitor(POLL),
    lambda user, _task, _: user.monitor(POLL, period=0),
    lambda user, _task, _: user.monitor(POLL, period=1, until=3),
    lambda user, _task, _: user.monitor(LOOK, period=1),
    lambda user, _task, _: user.monitor(ROCKS, perod=1),
    lambda user, _task, _: user.monitor(ROCKS).fire(HI),
    lambda user, _task, _: user.monitor(BLIND).fire(REST),
    lambda user, _task, _: user.on_failure("slipped", SHRUG),
    lambda user, _task, _: user.on_failure(SLIPPED, REST),
    lambda user, _task, _: user.on_failure(SLIPPED, SHRUG, of=SAY),
    lambda user, _task, _: user.on_failure(SLIPPED, SHRUG, maximum=-1),
    lambda user, _task, _: user.on_failure(FELL, GRIP),
    lambda user, _task, _: user.on_failure(None, GRIP),
    lambda _, task, _module: task.on_failure(FELL, GRIP),
    lambda user, _task, _: user.command(REST, on_failure=[(FELL, GRIP)]),
    lambda _, task, _module: task.fail(FELL),
    lambda _, task, _module: task.kill("\ud800"),
    lambda _, task, _module: task.kill(scope="all"),
    lambda _, task, _module: task.deadline(0),
    lambda _, task, _module: task.wait("soon"),
    lambda _, task, _module: task.wait_for("soon"),
    lambda _, task, _module: task.on_termination(SAY),
    lambda _, task, _module: task.retry(WALK, 1.0),
    lambda _, task, _module: task.retry(data=5),
    lambda _, task, _module: task.achieving.end + "soon",
    lambda _, task, _module: task.achieving.end <= task.planning.end + 1,
    lambda _, task, _module: task.achieving.end < task.planning.end,
    lambda _, task, _module: task.achieving.end <= task.planning.end <= task.planning.end,
    lambda user, _, _module: connect("", user.address),
    lambda *_: Module("legs", ""),
    lambda *_: Module("legs", capacity=0),
    lambda *_: Module("legs", requires="rest"),  # type: ignore[arg-type]
    lambda _user, _, legs: legs.resource("a\nb"),
    lambda _user, _, legs: legs.goal(WALK, 1.0),
    lambda _user, _, legs: legs.handles(POLL)(two),
    lambda _user, _, legs: legs.handles("rest")(two),
    lambda _user, _, legs: legs.handles(REST)(5),
    lambda _user, _, legs: legs.handles(WALK)(lambda _: None),
    lambda _user, _, legs: legs.handles(REST, pool="")(two),
    lambda _user, _, legs: legs.handles(SAY, pending=0)(two),
    lambda _user, _, legs: legs.handles(HEAT, pending=2)(two),
    lambda _user, _, legs: legs.handles(SAY, direct="yes")(two),
    lambda _user, _, legs: legs.handles(WALK, direct=True)(two),
    lambda _user, _, legs: legs.handles(SAY, direct=True, pending=3)(two),
    lambda _user, _, legs: legs.every(0)(print),
    lambda _user, _, legs: legs.after(-1, print),
    lambda _user, _, legs: legs.after(1, coming),
    lambda _user, _, legs: legs.after(1, two),
    lambda _user, _, legs: legs.on_readable("file", print),
    lambda _user, _, legs: legs.at_start(two),
]  # fmt: skip


def test_what_is_said_of_a_wrong_call(user: Client, legs: Module, *, rewrite: bool) -> None:
    """``pytest --rewrite`` writes the list anew: commit only what is better English."""
    task, said = user.command(REST), []
    for call in CALLS:
        with pytest.raises((MisuseError, BadData)) as error:
            call(user, task, legs)
        said.append(f"{error.value}\n")
    approved = Path(__file__).parent / "misuse.txt"
    if rewrite:
        approved.write_text("".join(said))
    assert "".join(said) == approved.read_text()


def test_what_is_said_at_the_wrong_time_or_in_the_wrong_thread(user: Client, legs: Module) -> None:
    said: list[str] = []

    def elsewhere() -> None:
        with pytest.raises(MisuseError, match="belongs to the one that opened it"):
            user.broadcast(HI)
        said.append("refused")

    @legs.handles(REST)
    def rest(task: Task) -> LaterReply[None]:
        with pytest.raises(MisuseError, match="comes too late: declare before run"):
            legs.resource("arm")
        with pytest.raises(MisuseError, match="runs already"):
            legs.run()
        later = task.reply_later()
        with pytest.raises(MisuseError, match="give it FAILURE"):
            later.fail("rock")  # type: ignore[arg-type]
        later.reply()
        with pytest.raises(MisuseError, match="has been answered already"):
            later.reply()
        said.append("late")
        return later

    with legs.running():
        user.command(REST).result(SOON)
        thread = threading.Thread(target=elsewhere)
        thread.start()
        thread.join(SOON)
    user.close()
    with pytest.raises(MisuseError, match="this client is closed"):
        user.query(WHERE)
    assert said == ["late", "refused"]
