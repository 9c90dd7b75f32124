"""Each journal entry names its cause: a request and the handler that made it, a timer, or a lost
connection.
"""

import pytest
from central.player import Player

from tca_wire.journal.causes import Cause, ConnectionLost, Request, TimeOver
from tca_wire.journal.facts import Entry, Killed, Retried
from tca_wire.packets import headers
from tca_wire.packets.parts import Attachment
from tca_wire.points import ROOT, TaskId
from tca_wire.vocabulary import Due


def robot() -> Player:
    player = Player()
    player.module("legs", "command move", capacity=2)
    player.module("expert", "exception handler recover")
    player.module("user")
    return player


def with_fact(player: Player, kind: type) -> list[Entry]:
    return [
        entry for entry in player.entries if any(isinstance(fact, kind) for fact in entry.facts)
    ]


def causes(player: Player, kind: type) -> list[Cause | None]:
    return [entry.cause for entry in with_fact(player, kind)]


def test_request_cause_names_connection_message_and_origin() -> None:
    player = robot()
    player.task("user", "move")
    player.task("legs/1", "move", origin=player.delivered("legs/1")[-1])
    player.task("legs/1", "move")
    *_, first, second, third = (entry.cause for entry in player.entries)
    assert first == Request("user", 0, player.numbers["user"], "Send")
    assert second == Request("legs", 1, player.numbers["legs/1"] - 1, "Send", 1)
    assert third == Request("legs", 1, player.numbers["legs/1"], "Send")


@pytest.mark.parametrize("origin", [99, 2])
def test_stale_or_foreign_origin_is_not_recorded_as_cause(origin: int) -> None:
    player = robot()
    player.task("user", "move")
    player.task("user", "move")
    player.reply("legs/2", 2)
    player.request("legs/1", headers.Suspend, TaskId(1), origin=origin)
    player.request("user", headers.Suspend, TaskId(1), resume=True, origin=1)
    assert [
        entry.cause.origin for entry in player.entries[-2:] if isinstance(entry.cause, Request)
    ] == [0, 0]


def recovering() -> tuple[Player, int, int]:
    """Return a player with a failed move, the move's task, and the delivery to its exception
    handler.
    """
    player = robot()
    player.task("user", "move", attachments=[Attachment("", "recover")])
    player.fail("legs/1", "slip")
    (handler,) = player.delivered("expert/1")
    return player, 1, handler


def test_recovery_kill_and_retry_name_the_exception_handler() -> None:
    player, task, handler = recovering()
    player.request("expert/1", headers.Retry, TaskId(task), origin=handler)
    (cause,) = causes(player, Retried)
    assert isinstance(cause, Request)
    assert (cause.module, cause.message, cause.origin) == ("expert", "Retry", handler)
    player, task, handler = recovering()
    player.request("expert/1", headers.Kill, TaskId(task), origin=handler)
    (killed,) = player.facts(Killed)
    assert (killed.by, killed.origin, killed.failed) == ("expert", handler, ROOT)


def test_planned_kill_names_the_handler_that_planned_it() -> None:
    player, task, handler = recovering()
    player.request("expert/1", headers.Kill, TaskId(task), delay=5.0, origin=handler)
    player.resolve("expert/1")
    player.reply("expert/1")
    player.task("user", "move")
    player.tick(5.0)
    assert not player.facts(Killed)  # the failure was resolved, and the move has ended
    player, task, handler = recovering()
    player.request("expert/1", headers.Kill, TaskId(task), delay=5.0, origin=handler)
    player.tick(5.0)
    assert [(fact.by, fact.origin) for fact in player.facts(Killed)] == [("expert", handler)]
    assert causes(player, Killed) == [TimeOver(Due.KILL, task)]


def test_kill_after_unhandled_failure_names_the_failed_task() -> None:
    player = robot()
    player.task("user", "move")
    inner = player.task("legs/1", "move", under=1)
    player.fail("legs/2", "slip", inner)
    assert {(fact.task, fact.by, fact.failed) for fact in player.facts(Killed)} == {
        (1, "central", 2),
        (2, "central", 2),
    }


def test_timers_due_in_one_event_are_separate_entries() -> None:
    player = robot()
    for seconds in (20.0, 10.0, 0.0):
        player.request("user", headers.Send, "move", deadline=seconds)
    player.request("user", headers.Kill, TaskId(3), delay=15.0)
    before = len(player.entries)
    player.tick(99.0)
    new = player.entries[before:]
    due = [TimeOver(Due.DEADLINE, 2), TimeOver(Due.KILL, 3), TimeOver(Due.DEADLINE, 1)]
    assert [entry.cause for entry in new] == due
    assert [entry.number for entry in new] == list(range(new[0].number, new[0].number + 3))


def test_garbled_lost_and_new_connections_are_recorded_causes() -> None:
    player = robot()
    player.garbage("user")
    player.garbage("nobody")
    player.lose("legs/2")
    *_, known, unknown, lost = (entry.cause for entry in player.entries)
    assert known == Request("user", 0, 0, "")
    assert unknown == Request("?", 0, 0, "")
    assert lost == ConnectionLost("legs", 2)
    player.hello("eye")
    assert player.entries[-1].cause == Request("eye", 0, 1, "Hello")
