"""Limits that keep one module from blocking all others."""

from collections.abc import Callable
from types import ModuleType
from typing import Any

import pytest
from central.player import INTEGER, Player, before, point

from dev.invariants import check_invariants
from tca_central.control import keeping, steering
from tca_central.events import DiskSpace
from tca_central.failing import attaching
from tca_central.locks import claims
from tca_central.model import registry
from tca_central.order import dispatcher
from tca_central.status.topics import overview
from tca_central.watching import taps
from tca_wire.constraints import Flags
from tca_wire.journal.facts import Killed
from tca_wire.packets import headers
from tca_wire.packets.parts import Attachment, HandlerFormat, MessageFormat
from tca_wire.points import Moment, TaskId
from tca_wire.text.waits_in_words import in_words
from tca_wire.vocabulary import Condition, Dropping, Limit, MessageClass, Refusal, Scope
from tca_wire.waits import WaitFor, WaitKind


def test_constraints_per_request_are_limited() -> None:
    player = Player.of("legs: command move", "user")
    task, other = player.task("user", "move"), player.task("user", "move")
    constraint = before(point(task, Moment.END_ACHIEVING), point(other, Moment.END_ACHIEVING))
    (answer,) = player.request("user", headers.Constrain, [constraint] * 1001)
    assert answer.text == "1001 constraints in one request: 1000 are allowed, send several requests"
    (answer,) = player.request("user", headers.Constrain, [constraint] * 1000)
    assert isinstance(answer, headers.Accepted)


def test_queue_limit_applies_to_each_broadcast_handler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dispatcher, "QUEUE_LIMIT", 3)
    player = Player.of("slow: broadcast pose, multi-query all", "user")
    for _ in range(3):
        player.send("user", "pose")
    player.module("quick", "broadcast pose")
    for _ in range(4):
        player.send("user", "pose")
        player.reply("quick/1")
    assert len(player.facts_of("dropped")) == 3
    answers = player.send("user", "all")
    assert [type(answer) for answer in answers] == [headers.Answer]  # all handlers have full queues


def test_unhandled_queries_and_informs_are_bounded(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(dispatcher, "QUEUE_LIMIT", 2)
    player = Player.of("user")
    player.declare("user", "query where", "inform note")
    answers = [player.send("user", "where") for _ in range(3)]
    assert answers[2][0].refusal is Refusal.OVERLOAD
    for _ in range(3):
        send_unconfirmed(player, "note")
    assert len(player.facts_of("dropped")) == 1


def test_confirmed_send_is_refused_instead_of_dropped(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(dispatcher, "QUEUE_LIMIT", 2)
    player = Player.of("map: inform note, broadcast pose", "user")
    answers = [player.send("user", "note")[-1] for _ in range(4)]
    assert [type(answer) for answer in answers] == [headers.Accepted] * 3 + [headers.Refused]
    assert answers[3].refusal is Refusal.OVERLOAD
    (refused,) = player.send("user", "note", if_handled=True)
    assert refused.refusal is Refusal.OVERLOAD
    (refused,) = player.send("user", "pose")
    assert refused.refusal is Refusal.OVERLOAD
    player.module("logger", "broadcast pose")
    accepted = player.send("user", "pose")[-1]  # the queue of the logger has room
    assert isinstance(accepted, headers.Accepted)
    assert [fact.copy_of for fact in player.facts_of("dropped")] == [accepted.id]


def test_dropped_messages_are_counted_with_their_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dispatcher, "QUEUE_LIMIT", 1)
    player = Player.of("map: inform note", "user")
    for _ in range(5):
        send_unconfirmed(player, "note")
    assert [fact.dropping for fact in player.facts_of("dropped")] == [Dropping.OVERLOAD] * 3
    assert player.central.registry.messages["note"].dropped == 3
    assert overview(player.central)["dropped"] == 3


def send_unconfirmed(player: Player, message: str) -> None:
    """Send an inform without a number, so that central does not confirm it."""
    player.receive("user", headers.Send(0, message))


def test_queue_overload_names_the_waiting_messages(monkeypatch: pytest.MonkeyPatch) -> None:
    """The queue is full of tasks here. Tasks are never refused, and may exceed the limit."""
    monkeypatch.setattr(dispatcher, "QUEUE_LIMIT", 2)
    player = Player.of("map: command survey, query where, inform note, multi-query all", "user")
    first, second, *_ = [
        player.task("user", "survey", flags=Flags.NONE, priority=-1) for _ in range(4)
    ]
    busy = WaitFor(
        WaitKind.RESOURCE, module="map", because=(WaitFor(WaitKind.RUNNING, first, "survey"),)
    )
    full = f"3 messages wait {in_words(busy)}, survey {{{second}}} first in line; from 2 on only tasks are let in"
    (refused,) = player.send("user", "where")
    assert (refused.refusal, refused.text) == (Refusal.OVERLOAD, f"{full}: try later")
    send_unconfirmed(player, "note")
    assert [dropped.why for dropped in player.facts_of("dropped")] == [full]
    player.send("user", "all")
    assert [failed.text for failed in player.facts_of("failed")] == [full]


def test_queue_overload_names_pool_and_lock_holder(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(dispatcher, "QUEUE_LIMIT", 1)
    player = Player.of("map: query where", "user")
    player.request("user", headers.Lock, "map")
    player.send("user", "where")
    assert player.send("user", "where")[0].text == (
        "1 message waits for map, which user has locked, where {2} first in line; from 1 on only tasks are let in: "
        "try later"
    )
    player.module("camera", "query look", pool="eyes")
    player.module("camera 2", "query look", pool="eyes")
    for _ in range(3):
        player.send("user", "look")
    assert "for camera 2 (or 1 more), busy with look {" in player.send("user", "look")[0].text


def test_long_failure_text_keeps_beginning_and_end() -> None:
    player = Player.of("eyes: query look", "user")
    player.send("user", "look")
    text = f"ValueError: not an image: {'iVBORw0K' * 4000}\nTraceback, at last: line 7"
    player.receive("eyes/1", headers.Fail(player.delivered("eyes/1")[-1], "x" * 1000, text))
    (failed,) = player.facts_of("failed")
    assert len(failed.failure) == Limit.NAME
    assert failed.text.startswith("ValueError: not an image: iVBOR")
    assert failed.text.endswith("iVBORw0K\nTraceback, at last: line 7")
    assert failed.text.count("…") == 1
    assert Limit.TEXT - 2 <= len(failed.text) <= Limit.TEXT


def test_next_exception_handler_receives_long_failure_text() -> None:
    player = Player.of("legs: command move", "expert: exception handler recover", "user")
    for of in ("", "move"):
        player.request("expert", headers.Attach, Attachment("slip", "recover"), TaskId(0), of)
    player.task("user", "move")
    text = f"ValueError: not an image: {'iVBORw0K' * 4000}"
    player.receive("legs/1", headers.Fail(player.delivered("legs/1")[-1], "slip", text))
    sent = player.fail("expert/1", "timeout")
    (asked,) = [header for header in sent if isinstance(header, headers.Deliver)]
    context = str(asked.context)
    assert "ValueError: not an image: iVBOR" in context
    assert "exception handler recover {4} could not decide: timeout" in context


def test_message_names_are_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "MESSAGES", 2)
    player = Player.of("user")
    player.declare("user", "query a", "query b")
    (answer,) = player.declare("user", "query c")
    assert answer.text == "2 messages have been declared: 'c' is too many"


def test_void_queue_entries_are_removed() -> None:
    player = Player.of("map: query where", "user", check=False)
    player.send("user", "where")
    player.send("user", "where")
    for _ in range(500):
        player.send("user", "where")
        player.receive("user", headers.GiveUp(player.numbers["user"]))
    resource = player.central.registry.modules["run of map"].resources["map"]
    assert resource.waiting == 1
    assert len(resource._queue._heap) < 100


def test_forgotten_outcome_is_not_reported_as_done(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    player = Player()
    monkeypatch.setattr("tca_central.model.memory.REMEMBERED_OUTCOMES", 3)
    player.module("legs", "command move")
    player.module("user")
    failed = player.task("user", "move")
    player.fail("legs/1", "slipped")
    for _ in range(4):
        player.task("user", "move")
        player.reply("legs/1", value=5)
    (answer,) = player.request("user", headers.AwaitPoint, point(failed, Moment.END_ACHIEVING))
    assert answer.text == f"task {{{failed}}} ended too long ago to know how: see the journal"


def test_negative_pending_limit_is_refused() -> None:
    player = Player.of("user")
    player.declare("user", "query where")
    handler = HandlerFormat("where", "user", "", -1)
    (answer,) = player.request("user", headers.Register, [], [handler])
    assert answer.text == "pending=-1 of 'where': give 1 or more, or 0 for no limit"
    assert player.facts_of("handler") == []


def test_point_monitor_fails_when_its_condition_cannot_be_sent(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    player = Player.of("user")
    player.declare("user", "query where", "command move")
    declared = MessageFormat("check", MessageClass.POINT_MONITOR, INTEGER, "", ["where", "move"])
    player.request("user", headers.Register, [declared])
    monkeypatch.setattr(dispatcher, "QUEUE_LIMIT", 0)
    player.task("user", "check")
    (failed,) = player.facts_of("failed")
    text = "0 messages wait for a module that handles where; from 0 on no more are let in"
    assert (failed.failure, failed.text) == (
        "overload",
        f"its condition 'where' could not be asked: {text}",
    )
    assert not player.central.tree.tasks


def test_retained_tasks_are_limited_in_number_and_bytes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(keeping, "MOST_RETAINED", 3)
    player = Player.of("legs: command move", "user")
    for _ in range(3):
        player.task("user", "move", keep=True)
    newest = player.central.tree.newest
    refused = player.send("user", "move", keep=True)[-1]
    assert (refused.refusal, player.central.tree.newest) == (Refusal.OVERLOAD, newest)
    assert "release some first" in refused.text
    for _ in range(2):
        player.reply("legs/1", value="x" * 100)
    assert list(player.central.memory.records) == [1, 2]
    player.central.budget.records = 150
    player.reply("legs/1", value="x" * 100)
    assert list(player.central.memory.records) == [3]
    player.task("user", "move", keep=True)
    player.reply("legs/1")
    assert list(player.central.memory.records) == [3, 4]


def test_deep_retained_tree_is_released_without_recursion() -> None:
    player = Player.of("planner: goal walk", "user", check=False)
    depth, parent = 1200, 0
    for _ in range(depth):
        parent = player.task("user", "walk", under=parent, flags=Flags.NONE, keep=True)
    while player.central.dispatcher.running:
        player.reply("planner/1")
    assert len(player.central.memory.records) == depth
    check_invariants(player.central)
    player.request("user", headers.Keep, TaskId(1), release=True)
    assert not player.central.memory.records
    check_invariants(player.central)


def test_pending_kills_and_deadlines_of_a_task_are_limited() -> None:
    player = Player(check=False)
    player.module("legs", "command move", capacity=2)
    player.module("user")
    task, other = player.task("user", "move"), player.task("user", "move", flags=Flags.NONE)
    end = point(task, Moment.END_ACHIEVING)
    for _ in range(500):
        player.request("user", headers.Deadline, end, 1e6)
        player.request("user", headers.Kill, TaskId(task), "", Scope.TASK, None, 1e6)
    text = f"1,000 kills, deadlines and delays are pending for move {{{task}}} already"
    for header in (
        headers.Deadline(0, end, 1.0),
        headers.Kill(0, TaskId(task), "", Scope.TASK, None, 1.0),
    ):
        (refused,) = player.receive("user", header)
        assert refused.text == text
    player.reply("legs/1")
    assert not player.central.clock.pending()
    assert player.central.tree.tasks.keys() == {other}
    check_invariants(player.central)


@pytest.mark.parametrize("number", [1, 5, 40])
def test_failing_exception_handlers_come_to_an_end(number: int) -> None:
    """The calls end for any number of exception handlers, and if these also handle the failures of
    one another.
    """
    player = Player.of("legs: command move", check=False)
    player.module(
        "expert",
        *(f"exception handler recover {one}" for one in range(number)),
        capacity=8 * number + 1,
    )
    player.module("user")
    for one in range(number):
        attachment = Attachment("", f"recover {one}")
        player.request("user", headers.Attach, attachment, TaskId(0), "move")
    task = player.task("user", "move")
    player.fail("legs/1", "slip")
    calls = 0
    while player.central.dispatcher.running:
        (delivery,) = player.central.dispatcher.running.values()
        calls += 1
        assert calls <= 10 * number
        assert delivery.slot
        player.fail(delivery.slot.id.decode(), "handler error", delivery.handling_id)
    assert calls == 9 * number - 1
    assert player.facts(Killed)[-1].why == f"failure 'slip' of move {{{task}}} was not handled"
    check_invariants(player.central)


def test_claims_on_a_resource_are_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(claims, "MOST_CLAIMS", 3)
    player = Player.of("legs: command move")
    answers = []
    for number in range(5):  # the first claim is granted
        player.module(f"user{number}")
        answers += player.request(f"user{number}", headers.Lock, "legs")
    *others, last = answers
    assert not any(isinstance(answer, headers.Refused) for answer in others)
    assert last.refusal is Refusal.OVERLOAD
    assert last.text == "3 claims wait to lock or reserve resource 'legs'"


@pytest.mark.parametrize("moment", [0, 3, 64])
def test_point_without_exactly_one_moment_is_refused(moment: int) -> None:
    player = Player.of("legs: command move", "user")
    where = point(player.task("user", "move"), Moment(moment))
    for header in (
        headers.AwaitPoint(player.number("user"), where),
        headers.Deadline(player.number("user"), where, 1),
    ):
        (refused,) = player.receive("user", header)
        assert refused.text == f"{moment} is not a moment: give one bit of 1 to 32"


def test_remembered_lost_claims_are_limited(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(claims, "MOST_CLAIMS", 3)
    player = Player.of("legs: command move", "user", "operator")
    for _ in range(5):
        player.request("user", headers.Lock, "legs")
        player.request("operator", headers.Unlock, "legs")
    (user,) = [
        one for one in player.central.registry.connections.values() if one.module.name == "user"
    ]
    assert len(user.lost_claims) == 3


def test_lost_lock_outside_handler_does_not_fail_the_handler() -> None:
    player = Player.of("legs: command move", "map: query where", "user")
    assert player.task("user", "move") == 1
    player.request("legs/1", headers.Lock, "map")
    player.request("user", headers.Unlock, "map")
    player.reply("legs/1")
    assert not player.facts_of("failed")


ATTACHMENTS: dict[str, tuple[ModuleType, str, Callable[[int, int], Any], str]] = {
    "wiretaps": (
        taps,
        "MOST_TAPS",
        lambda request, task: headers.Tap(
            request, Condition.WHEN_ACHIEVED, "move" if request % 2 else "walk", "", TaskId(task)
        ),
        "has 1 wiretaps already",
    ),
    "exception handlers": (
        attaching,
        "MOST_ATTACHED",
        lambda request, task: headers.Attach(
            request, Attachment(f"failure {request}", "recover"), TaskId(task)
        ),
        "has 1 exception handlers already",
    ),
    "termination messages": (
        steering,
        "MOST_TERMINATION_MESSAGES",
        lambda request, task: headers.Send(request, "move", parent=TaskId(task), when_killed=True),
        "1 messages are stored for its termination",
    ),
}


@pytest.mark.parametrize("what", ATTACHMENTS)
def test_attachments_of_a_task_are_limited(what: str, monkeypatch: pytest.MonkeyPatch) -> None:
    module, limit, make, text = ATTACHMENTS[what]
    monkeypatch.setattr(module, limit, 1)
    player = Player.of("user")
    player.declare("user", "goal walk", "command move", "query where", "exception handler recover")
    task = player.task("user", "walk")
    for _ in range(2):
        answers = player.request("user", make, task)
    (refused,) = answers
    assert refused.refusal is Refusal.OVERLOAD
    assert text in refused.text


# --- a nearly full disk ---------------------------------------------------------------------------


def test_task_is_refused_while_disk_is_nearly_full() -> None:
    player = Player.of("legs: command move, query where", "user")
    running = player.task("user", "move")
    player.event(DiskSpace(player.time, is_low=True))
    (refused,) = player.send("user", "move")
    assert (
        refused.text
        == "the disk of central's journal is nearly full: no command is accepted before it has room"
    )
    player.reply("legs/1", running)
    player.send("user", "where")
    assert any(isinstance(one, headers.Deliver) for one, _ in player.inbox["legs/1"])
    player.reply("legs/1")
    player.event(DiskSpace(player.time, is_low=False))
    assert player.task("user", "move")
