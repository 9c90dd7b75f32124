"""Quietly sent tasks. Their senders name them by requests, and learn their ids in batches."""

from typing import Any

import msgspec
import pytest
from central.player import Player, before, point
from hypothesis import given, settings
from hypothesis import strategies as st
from properties.life import Life

from tca_central.events import ConfirmTasks, ConnectionId
from tca_central.model.deliveries import CONFIRMED_TOGETHER, REMEMBERED_TASKS
from tca_wire.packets import headers
from tca_wire.packets.headers import Accepted, AwaitPoint, Refused, TasksMade
from tca_wire.packets.parts import WatchOptions
from tca_wire.points import THIS, Moment, TaskId
from tca_wire.vocabulary import Refusal

END, START = Moment.END_ACHIEVING, Moment.START_ACHIEVING


def sent_quietly(player: Player, connection: str, message: str, **options: Any) -> int:
    """Send a message quietly. Return the number of the request."""
    player.send(connection, message, quiet=True, **options)
    return player.numbers[connection]


def robot() -> Player:
    return Player.of("planner: goal walk", "legs: command move", "user")


def tasks_of(player: Player, connection: str) -> dict[int, TaskId]:
    """Return the tasks that a connection has sent, by request."""
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


class NamingPlayer(Player):
    """A player that names each task by its request where that is possible."""

    named = 0
    """The number of headers that were changed."""

    def receive(self, connection: str, header: Any, body: bytes = b"") -> list[Any]:
        if ConnectionId(connection.encode()) in self.central.registry.connections:
            requests = {task: request for request, task in tasks_of(self, connection).items()}
            renamed = _renamed(header, requests)
            self.named += renamed != header
            header = renamed
        return super().receive(connection, header, body)


@given(st.integers(0, 1 << 32))
@settings(max_examples=3, deadline=None)
def test_naming_tasks_by_their_requests_changes_nothing(seed: int) -> None:
    """The journal is the same, and the names reach no other connection."""
    plain, naming = Life(Player(check=False)), Life(NamingPlayer(check=False))
    for life in (plain, naming):
        life.go_on(seed, 300)
    assert isinstance(naming.player, NamingPlayer)
    assert naming.player.named > 3
    assert naming.player.entries == plain.player.entries
    assert naming.player.inbox == plain.player.inbox


def test_quiet_sender_is_told_of_its_task_ids_in_batches() -> None:
    player = robot()
    requests = [sent_quietly(player, "user", "walk") for _ in range(CONFIRMED_TOGETHER + 1)]
    confirmations = [header for header, _ in player.inbox["user"] if isinstance(header, TasksMade)]
    assert confirmations == [
        TasksMade([(request, TaskId(n + 1)) for n, request in enumerate(requests[:-1])])
    ]
    (effect,) = player.central.handle(ConfirmTasks(player.time))
    assert effect.header == TasksMade([(requests[-1], TaskId(CONFIRMED_TOGETHER + 1))])  # type: ignore[union-attr]
    assert player.central.handle(ConfirmTasks(player.time)) == []


def test_lost_connection_gets_no_task_confirmations() -> None:
    player = robot()
    sent_quietly(player, "user", "walk")
    player.lose("user")
    assert player.central.handle(ConfirmTasks(player.time)) == []


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
def test_request_naming_a_refused_task_is_refused(name: str) -> None:
    player = robot()
    player.task("user", "walk")
    refused = sent_quietly(
        player, "user", "walk", constraints=(before(point(THIS, END), point(THIS, START)),)
    )
    number = player.number("user")
    (answer,) = player.receive("user", NAMING[name](number, TaskId(-refused)))
    text = f"there is no task of request {refused}: it was refused, or {REMEMBERED_TASKS} others have been sent since"
    assert answer == Refused(number, Refusal.UNKNOWN, text)


def test_only_newest_tasks_can_be_named_by_request() -> None:
    player = Player.of("legs: command move", "user", check=False)
    oldest, newer, *_ = [sent_quietly(player, "user", "move") for _ in range(REMEMBERED_TASKS + 1)]
    for request, is_known in ((oldest, False), (newer, True)):
        *_, answer = player.request("user", headers.Suspend, TaskId(-request))
        assert isinstance(answer, Accepted) == is_known
