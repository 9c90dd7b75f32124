"""Ownership: no module can answer, end or give up a delivery, task or request of another."""

from collections.abc import Iterator
from typing import Any

import pytest
from central.player import Player, point

from tca_central.events import ConnectionId
from tca_wire.journal import facts
from tca_wire.journal.facts import Received
from tca_wire.packets import headers
from tca_wire.packets.headers import Accepted, Answer, Deliver, Refused, Unknown, Welcome
from tca_wire.packets.parts import EndedRun
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import Refusal

NUMBERS = range(1, 40)
"""Numbers that cover all deliveries, tasks and requests of the other modules."""


class RobotWithThief(Player):
    """A robot at work, and a thief among its modules."""

    def __init__(self) -> None:
        super().__init__()
        self.prefetch = 4
        self.module("legs", "command move", "inform note")
        self.module("planner", "goal walk", "query where")
        self.prefetch = 0
        self.module("user")
        self.module("thief", "query what")
        self.lose("thief/1")
        self.hello("thief/1", "thief", "thief")
        walk = self.task("user", "walk", keep=True)
        self.task("planner/1", "move", under=walk)
        for message in ("note", "note", "where"):
            self.send("user", message)
        self.request("user", headers.AwaitPoint, point(walk, Moment.END_ACHIEVING))
        self.request("user", headers.Lock, "legs", "legs")
        self.request("user", headers.Lock, "planner", "planner")

    def finish_work(self) -> None:
        """Let the other modules end all their work."""
        for _ in range(20):
            for line in ("legs/1", "planner/1"):
                if self.delivered(line):
                    self.reply(line)
            for _, number in [
                key for key, claim in self.central.claims.items() if claim.is_granted
            ]:
                self.request("user", headers.Release, number)

    def inboxes_of_others(self) -> dict[str, Any]:
        return {line: inbox for line, inbox in self.inbox.items() if not line.startswith("thief")}


def forged_headers() -> Iterator[Any]:
    """Yield headers with numbers of the other modules."""
    for number in NUMBERS:
        yield headers.Reply(number)
        yield headers.Fail(number, "slipped")
        yield headers.Fail(number, "", reissue=True)
        yield headers.Replies([EndedRun(number, 0.1, 0.1)])
        yield headers.Recalled([number])
        yield headers.Recalled([number], is_answer=False)
        yield headers.GiveUp(number)
        yield headers.Await(number)
        yield headers.AwaitAny(number, [1, 2, 3])
    yield headers.Recalled(list(NUMBERS))
    yield headers.AwaitAny(0, list(NUMBERS))


def forged_requests_with_numbers(player: Player, line: str) -> Iterator[Any]:
    for number in NUMBERS:
        yield headers.GiveUp(number, player.number(line))
        yield headers.Release(player.number(line), number)
        yield headers.Keep(player.number(line), TaskId(number), release=True)
    for number in (-1, -2, -3, -4, -5):
        yield headers.Kill(player.number(line), TaskId(number))
    yield headers.Unregister(player.number(line), ["walk", "note", "where"])


@pytest.mark.parametrize("line", ["thief", "thief/1"])
def test_forged_requests_change_nothing_for_other_modules(line: str) -> None:
    honest, robbed = RobotWithThief(), RobotWithThief()
    for header in (*forged_headers(), *forged_requests_with_numbers(robbed, line)):
        robbed.time -= 1.0
        answers = robbed.receive(line, header)
        assert all(isinstance(one, Refused | Accepted | Answer) for one in answers), (
            header,
            answers,
        )
    for robot in (honest, robbed):
        robot.finish_work()
    assert robbed.inboxes_of_others() == honest.inboxes_of_others()
    user = honest.central.registry.connections[ConnectionId(b"user")]
    assert not user.outstanding
    assert not honest.central.tree.tasks


def test_reply_to_foreign_delivery_is_refused_by_name() -> None:
    robot = RobotWithThief()
    (delivery,) = robot.delivered("planner/1")
    (answer,) = robot.receive("thief/1", headers.Reply(delivery))
    assert (
        answer.text
        == f"module 'thief' answers delivery {{{delivery}}}, which it was not given or has answered"
    )
    assert robot.delivered("planner/1") == [delivery]


def test_request_cannot_claim_a_foreign_origin() -> None:
    """Monitors, the deadlock search and the journal rely on the origin of a request."""
    robot = RobotWithThief()
    (delivery,) = robot.delivered("planner/1")
    for sender, origin in (("thief/1", 0), ("planner/1", delivery), ("planner", delivery)):
        robot.send(sender, "note", origin=delivery)
        assert robot.facts(Received)[-1].origin == origin
    (answer,) = robot.request("thief/1", headers.Lock, "legs", "legs", origin=delivery)
    assert "is not handled there" in answer.text


# --- principals of connections --------------------------------------------------------------------


def robot_with_principals() -> Player:
    player = Player()
    player.principals |= {"arm": "arm", "arm/1": "arm", "thief": "thief"}
    player.module("arm", "command grip")
    return player


def refusals(sent: list[object]) -> list[Refusal]:
    return [header.refusal for header in sent if isinstance(header, Refused)]


def test_module_joins_with_its_principal() -> None:
    joined = [
        fact
        for entry in robot_with_principals().entries
        for fact in entry.facts
        if isinstance(fact, facts.ModuleJoined)
    ]
    assert [(fact.module, fact.principal) for fact in joined] == [("arm", "arm")]


def test_session_of_another_principal_cannot_be_taken_over() -> None:
    player = robot_with_principals()
    for number in range(3):
        hello = headers.Hello(
            1, headers.PROTOCOL_VERSION, "arm", "run of arm", number, "arm" if number else ""
        )
        assert refusals(player.receive("thief", hello)) == [Refusal.FORBIDDEN]
    assert {one.principal for one in player.central.registry.connections.values()} == {"arm"}
    assert not any(isinstance(header, Deliver) for header, _ in player.inbox["thief"])


def test_lost_session_cannot_be_resumed_by_another_principal() -> None:
    player = robot_with_principals()
    for name in ("arm", *[name for name in player.inbox if name.startswith("arm/")]):
        player.lose(name)
    hello = headers.Hello(1, headers.PROTOCOL_VERSION, "arm", "run of arm")
    assert refusals(player.receive("thief", hello)) == [Refusal.FORBIDDEN]
    assert any(isinstance(header, Welcome) for header in player.receive("arm", hello)), (
        "its own principal gets it back"
    )


@pytest.mark.parametrize(
    "header", [headers.Unregister(9, []), headers.Bye(), headers.Reply(1), headers.Lock(9, "arm")]
)
def test_reused_connection_id_of_another_principal_is_unknown(header: object) -> None:
    """A new connection can reuse the id of a lost one before central has noticed the loss."""
    player = robot_with_principals()
    player.principals["arm/1"] = "thief"
    assert [type(one) for one in player.receive("arm/1", header)] == [Unknown]
    player.principals["arm/1"] = "arm"
    assert not any(isinstance(sent, Deliver) for sent, _ in player.inbox["arm/1"])
    assert player.central.registry.messages["grip"].handlers
    changed = [fact for fact in player.facts(facts.ResourceChanged) if fact.resource == "arm"]
    assert [fact.capacity for fact in changed] == [1, 0], "the slot counts as lost"
