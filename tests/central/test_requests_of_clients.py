"""So many requests of clients may wait for the word of a task's handler; those that need none may be any number."""

import msgspec
import pytest
from central.player import Player
from central.transcript import PAUSABLE

from tca_central.life_cycles.changes import MOST_ASKED
from tca_wire.life_cycles import GENERAL, Effect, LifeCycle, Transition, ending
from tca_wire.packets import headers
from tca_wire.packets.changes import Requested
from tca_wire.packets.parts import StateChange
from tca_wire.vocabulary import Party, Refusal

NAGGING = LifeCycle(
    "nagging",
    [
        *GENERAL.transitions,
        Transition("nag", "running", "nagged", Party.CLIENT),
        Transition("nag", "nagged", "nagged", Party.CLIENT),
        Transition("hush", "nagged", "running", Party.SERVER, Effect.REFUSE),
        *ending("nagged"),
    ],
)


@pytest.fixture
def player() -> Player:
    player = Player()
    player.life_cycles = {"move": NAGGING.text, "walk": PAUSABLE.text}
    player.module("legs", "command move", takes=["nag", "cancel"])
    player.module("feet", "command walk", takes=["pause", "resume"])
    player.module("user")
    player.declare("user", "command move", "command walk")
    return player


def test_what_the_handler_has_to_answer_is_limited(player: Player) -> None:
    task = player.task("user", "move")
    for _ in range(MOST_ASKED):
        *_, answer = player.change("user", task, "nag")
        assert isinstance(answer, headers.Accepted)
    *_, refused = player.change("user", task, "nag")
    assert isinstance(refused, headers.Refused)
    assert (refused.refusal, refused.text) == (
        Refusal.OVERLOAD, "32 requests wait for the handler of task 1 'move' already",
    )  # fmt: skip
    player.change("legs/1", task, "hush")
    assert isinstance(player.change("user", task, "nag")[-1], headers.Accepted)


def test_what_needs_no_answer_is_not(player: Player) -> None:
    task = player.task("user", "walk")
    for number in range(2 * MOST_ASKED):
        told = player.change("user", task, ("pause", "resume")[number % 2])
        assert [type(one) for one in told] == [Requested, headers.Accepted]


def test_a_handler_whose_line_was_cut_is_asked_again(player: Player) -> None:
    task = player.task("user", "move")
    player.change("user", task, "nag", text="faster")
    hello = headers.Hello(99, headers.PROTOCOL_VERSION, "legs", "run of legs", 1, "legs", "here:1")
    told = [one for one in player.receive("legs back", hello) if isinstance(one, Requested)]
    assert told == [Requested(task, "nag", 2, "faster")]


def test_a_long_reason_is_cut(player: Player) -> None:
    task = player.task("user", "move")
    *_, asked, accepted = player.change("user", task, "nag", text="x" * 100_000)
    assert isinstance(accepted, headers.Accepted)
    assert len(asked.text) < 20_000


def test_an_observer_of_what_is_under_a_task_is_told_of_what_is_there(player: Player) -> None:
    player.module("planner", "goal tidy")
    goal = player.task("user", "tidy")
    player.task("user", "move", under=goal)
    player.observe("user", below=goal)
    told = [msgspec.msgpack.decode(body, type=StateChange) for _, body in player.inbox["user"] if body]
    assert [(one.message, one.is_late) for one in told] == [("move", True)]
