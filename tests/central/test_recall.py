"""A task whose sender gave up before it heard that the task was taken: it is killed by the number of its request."""

from central.player import Player

from tca_wire.journal import facts
from tca_wire.packets.headers import Accepted, Kill
from tca_wire.points import ROOT


def recall(player: Player, request: int) -> list[int]:
    """What central says was killed."""
    number = player.number("user")
    answers = player.receive("user", Kill(number, ROOT, "given up", request=request))
    return [answer.id for answer in answers if isinstance(answer, Accepted) and answer.number == number]


def test_what_came_is_killed_with_all_under_it() -> None:
    player = Player()
    player.module("legs", "goal walk")
    player.module("user")
    walk = player.task("user", "walk")
    sent_with = player.numbers["user"]
    player.task("user", "walk")
    step = player.task("legs/1", "walk", under=walk)
    assert recall(player, sent_with) == [walk]
    killed = player.facts(facts.Killed)
    assert [(fact.task, fact.why) for fact in killed] == [(walk, "given up"), (step, "given up")]


def test_what_has_not_come_never_will() -> None:
    """A request that arrives after the one with a higher number is answered, and not done."""
    player = Player()
    player.module("legs", "goal walk")
    player.module("user")
    lost = player.number("user")
    assert recall(player, lost) == [0]
    assert not [one for one in player.send("user", "walk", number=lost) if isinstance(one, Accepted)]
    assert list(player.central.tree.tasks) in ([], [ROOT])


def test_what_has_ended_or_was_refused_or_is_no_task_is_left_alone() -> None:
    player = Player()
    player.module("legs", "command lift", "inform note")
    player.module("user")
    lift = player.task("user", "lift")
    sent_with = player.numbers["user"]
    player.reply("legs/1")
    assert recall(player, sent_with) == [0]
    assert [fact.text for fact in player.facts(facts.Ignored)] == [f"task {lift} has ended: it can't be killed"]
    player.send("user", "no such message")
    assert recall(player, player.numbers["user"]) == [0]
    assert lift not in player.central.tree.tasks


def test_said_again_after_a_break_it_is_done_once() -> None:
    player = Player()
    player.module("legs", "goal walk")
    player.module("user")
    first = player.task("user", "walk")
    request = player.numbers["user"]
    recall(player, request)
    number = player.numbers["user"]
    (answer,) = player.receive("user", Kill(number, ROOT, "given up", request=request))
    assert answer == Accepted(number, first)
    assert len(player.facts(facts.Killed)) == 1


def test_the_requests_of_others_are_theirs() -> None:
    player = Player()
    player.module("legs", "goal walk")
    player.module("user")
    player.module("thief")
    player.task("user", "walk")
    number = player.number("thief")
    assert player.receive("thief", Kill(number, ROOT, request=player.numbers["user"])) == [Accepted(number)]
