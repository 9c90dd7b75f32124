"""Tasks that are sent quietly: named by their requests, told of together, and refused to their senders."""

from typing import Any

import msgspec
import pytest
from central.player import Player, before, point
from hypothesis import given, settings
from hypothesis import strategies as st
from properties.life import Life

from tca_central.events import ConnectionId, TellAll
from tca_central.model.deliveries import REMEMBERED_TASKS, TOLD_TOGETHER
from tca_wire.journal import facts
from tca_wire.packets import headers
from tca_wire.packets.headers import Accepted, Answer, Await, AwaitPoint, Deliver, Refused, Reply, TasksMade
from tca_wire.packets.parts import Attachment, WatchOptions
from tca_wire.points import THIS, Moment, TaskId
from tca_wire.vocabulary import Outcome, Refusal

END, START = Moment.END_ACHIEVING, Moment.START_ACHIEVING


def sent_quietly(player: Player, connection: str, message: str, **options: Any) -> int:
    """The number of the request."""
    player.send(connection, message, quiet=True, **options)
    return player.numbers[connection]


def robot() -> Player:
    return Player.of("planner: goal walk", "legs: command move", "user")


def tasks_of(player: Player, connection: str) -> dict[int, TaskId]:
    """The tasks that a connection has sent, by request."""
    return player.central.registry.connections[ConnectionId(connection.encode())].tasks


def _renamed(value: Any, requests: dict[TaskId, int]) -> Any:
    if isinstance(value, list):
        return [_renamed(one, requests) for one in value]
    if not isinstance(value, msgspec.Struct) or isinstance(value, headers.Remove):
        return value
    changes = {}
    for field in value.__struct_fields__:
        old = getattr(value, field)
        is_task = field in ("task", "parent", "monitor") and old in requests
        changes[field] = TaskId(-requests[old]) if is_task else _renamed(old, requests)
    return msgspec.structs.replace(value, **changes)


class Naming(Player):
    """Names by its request what it can."""

    named = 0

    def receive(self, connection: str, header: Any, body: bytes = b"") -> list[Any]:
        if ConnectionId(connection.encode()) in self.central.registry.connections:
            requests = {task: request for request, task in tasks_of(self, connection).items()}
            renamed = _renamed(header, requests)
            self.named += renamed != header
            header = renamed
        return super().receive(connection, header, body)


@given(st.integers(0, 1 << 32))
@settings(max_examples=3, deadline=None)
def test_a_task_that_is_named_by_its_request_is_that_task(seed: int) -> None:
    """Whatever happens: the journal is the same, and nobody else is told of such names."""
    plain, naming = Life(Player(check=False)), Life(Naming(check=False))
    for life in (plain, naming):
        life.go_on(seed, 300)
    assert isinstance(naming.player, Naming)
    assert naming.player.named > 10
    assert naming.player.entries == plain.player.entries
    assert naming.player.inbox == plain.player.inbox


def test_nothing_is_said_of_a_quiet_task_until_its_sender_is_told_something_else() -> None:
    player = robot()
    walk = sent_quietly(player, "user", "walk")
    end = player.number("user")
    heard = player.receive("user", AwaitPoint(end, point(-walk, END)))
    assert heard == []
    assert player.reply("planner/1") == [TasksMade([(walk, TaskId(1))]), Answer(end)]


def test_who_waits_for_an_id_is_told_it_at_once() -> None:
    player = robot()
    first, second = (sent_quietly(player, "user", "walk") for _ in range(2))
    told = TasksMade([(first, TaskId(1)), (second, TaskId(2))])
    assert player.receive("user", Await(first)) == [told]
    assert player.receive("user", Await(first)) == []


def test_of_many_the_sender_is_told_at_once_and_of_the_rest_with_the_next_beat() -> None:
    player = robot()
    requests = [sent_quietly(player, "user", "walk") for _ in range(TOLD_TOGETHER + 1)]
    told = [header for header, _ in player.inbox["user"] if isinstance(header, TasksMade)]
    assert told == [TasksMade([(request, TaskId(n + 1)) for n, request in enumerate(requests[:-1])])]
    (effect,) = player.central.handle(TellAll(player.time))
    assert effect.header == TasksMade([(requests[-1], TaskId(TOLD_TOGETHER + 1))])  # type: ignore[union-attr]
    assert player.central.handle(TellAll(player.time)) == []


def test_a_connection_that_is_gone_is_told_nothing() -> None:
    player = robot()
    sent_quietly(player, "user", "walk")
    player.lose("user")
    assert player.central.handle(TellAll(player.time)) == []


def test_said_again_after_a_break_it_is_answered_by_itself() -> None:
    player = robot()
    walk = sent_quietly(player, "user", "walk")
    player.lose("user")
    player.hello("user again", "user", incarnation="run of user")
    assert player.send("user again", "walk", number=walk) == [Accepted(walk, 1)]
    assert player.receive("user again", headers.Kill(walk + 1, TaskId(-walk)))[-1] == Accepted(walk + 1, 1)
    assert len(player.facts(facts.Received)) == 1


NAMING: dict[str, Any] = {
    "send under it": lambda number, task: headers.Send(number, "move", parent=task),
    "send after it": lambda number, task: headers.Send(number, "move", constraints=[before(point(task, END), point(THIS, START))]),
    "watch until": lambda number, task: headers.Send(number, "move", watch=WatchOptions(until=point(task, END))),
    "constrain": lambda number, task: headers.Constrain(number, [before(point(task, END), point(task, START))]),
    "wait": lambda number, task: AwaitPoint(number, point(task, END)),
    "raise": lambda number, task: headers.Raise(number, task, "stuck"),
    "kill after": lambda number, task: headers.Kill(number, TaskId(1), after=point(task, END)),
    "suspend": headers.Suspend,
    "deadline": lambda number, task: headers.Deadline(number, point(task, END), 1.0),
    "inspect": lambda number, task: headers.Inspect(number, task, "self"),
    "keep": headers.Keep,
    "end monitor": headers.EndMonitor,
}  # fmt: skip


@pytest.mark.parametrize("name", NAMING)
def test_what_names_a_refused_task_is_refused(name: str) -> None:
    player = robot()
    player.task("user", "walk")
    refused = sent_quietly(player, "user", "walk", constraints=(before(point(THIS, END), point(THIS, START)),))
    number = player.number("user")
    (answer,) = player.receive("user", NAMING[name](number, TaskId(-refused)))
    text = f"there is no task of request {refused}: that was refused, or {REMEMBERED_TASKS} others have been sent since"
    assert answer == Refused(number, Refusal.UNKNOWN, text)


def test_the_tasks_of_another_connection_are_not_named() -> None:
    player = robot()
    walk = sent_quietly(player, "user", "walk")
    number = player.number("planner")
    (answer,) = player.receive("planner", headers.Suspend(number, TaskId(-walk)))
    assert answer.refusal is Refusal.UNKNOWN


def test_the_newest_tasks_can_be_named() -> None:
    player = Player.of("legs: command move", "user", check=False)
    oldest, newer, *_ = [sent_quietly(player, "user", "move") for _ in range(REMEMBERED_TASKS + 1)]
    for request, is_known in ((oldest, False), (newer, True)):
        *_, answer = player.receive("user", headers.Suspend(player.number("user"), TaskId(-request)))
        assert isinstance(answer, Accepted) == is_known


# --- refusals that a handler may not have heard ----------------------------------------------------------------------


def handler_with_a_refused_send(player: Player) -> int:
    """The task whose handler runs on planner/1."""
    walk = player.task("user", "walk")
    circle = (before(point(THIS, END), point(THIS, START)),)
    answers = player.send("planner/1", "move", under=walk, constraints=circle, quiet=True)
    assert [type(one) for one in answers] == [Refused]
    return walk


def test_a_handler_that_does_not_know_of_a_refusal_has_failed() -> None:
    player = robot()
    walk = handler_with_a_refused_send(player)
    player.reply("planner/1")
    (failed,) = player.facts(facts.Failed)
    assert (failed.id, failed.failure) == (walk, "handler error")
    assert failed.text.startswith("'move' was refused: constraint end achieving task 2 <= start achieving task 2 can")
    (returned,) = player.facts(facts.Returned)
    assert returned.outcome is Outcome.FAILED


def test_a_handler_that_knows_of_its_refusals_has_not_failed() -> None:
    player = robot()
    walk = handler_with_a_refused_send(player)
    player.receive("planner/1", Reply(walk, refusals=1), b"\xc0")
    assert player.facts(facts.Failed) == []
    assert walk not in player.central.tree.tasks


def test_what_was_refused_to_an_earlier_handler_of_the_task_does_not_count() -> None:
    player = Player.of("planner: goal walk", "legs: command move", "user", "helper: exception handler again")
    walk = handler_with_a_refused_send(player)
    player.receive("user", headers.Attach(player.number("user"), Attachment("", "again"), TaskId(walk)))
    player.fail("planner/1", "stuck")
    player.receive(
        "helper/1", headers.Retry(player.number("helper/1"), TaskId(walk), origin=player.delivered("helper/1")[0])
    )
    player.reply("helper/1")
    deliveries = [header for header, _ in player.inbox["planner/1"] if isinstance(header, Deliver)]
    assert len(deliveries) == 2
    player.reply("planner/1")
    assert [fact.failure for fact in player.facts(facts.Failed)] == ["stuck"]


def test_a_refusal_that_was_told_at_once_is_the_senders_own_affair() -> None:
    player = robot()
    walk = player.task("user", "walk")
    player.send("planner/1", "no such message", under=walk)
    player.reply("planner/1")
    assert player.facts(facts.Failed) == []
