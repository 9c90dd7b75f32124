"""Requests of clients to change the state of a task: their limits, and their order with the
handler's changes.
"""

import msgspec
import pytest
from central.player import IN_PYTHON, Player
from central.transcript import PAUSABLE

from tca_central.life_cycles import observing
from tca_central.life_cycles.changes import MOST_ASKED
from tca_wire.journal.facts import StateChanged
from tca_wire.life_cycles import GENERAL, Effect, LifeCycle, Transition, ending
from tca_wire.packets import headers
from tca_wire.packets.changes import Requested
from tca_wire.packets.parts import StateChange
from tca_wire.points import TaskId
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


def test_unanswered_client_requests_are_limited(player: Player) -> None:
    task = player.task("user", "move")
    for _ in range(MOST_ASKED):
        *_, answer = player.change("user", task, "nag")
        assert isinstance(answer, headers.Accepted)
    *_, refused = player.change("user", task, "nag")
    assert isinstance(refused, headers.Refused)
    assert (refused.refusal, refused.text) == (
        Refusal.OVERLOAD,
        "32 requests wait for the handler of move {1} already",
    )
    player.change("legs/1", task, "hush")
    assert isinstance(player.change("user", task, "nag")[-1], headers.Accepted)


def test_client_requests_without_answers_are_not_limited(player: Player) -> None:
    task = player.task("user", "walk")
    for number in range(2 * MOST_ASKED):
        sent = player.change("user", task, ("pause", "resume")[number % 2])
        assert [type(one) for one in sent] == [Requested, headers.Accepted]


def test_reconnected_handler_is_asked_again(player: Player) -> None:
    task = player.task("user", "move")
    player.change("user", task, "nag", text="faster")
    hello = headers.Hello(99, headers.PROTOCOL_VERSION, "legs", "run of legs", 1, "legs", "here:1")
    requested = [one for one in player.receive("legs back", hello) if isinstance(one, Requested)]
    assert requested == [Requested(task, "nag", 2, "faster")]


def test_long_transition_reason_is_truncated(player: Player) -> None:
    task = player.task("user", "move")
    *_, asked, accepted = player.change("user", task, "nag", text="x" * 100_000)
    assert isinstance(accepted, headers.Accepted)
    assert len(asked.text) < 20_000


def test_new_observer_of_descendants_receives_current_states(player: Player) -> None:
    player.module("planner", "goal tidy")
    goal = player.task("user", "tidy")
    player.task("user", "move", under=goal)
    player.observe("user", below=goal)
    changes = [
        msgspec.msgpack.decode(body, type=StateChange) for _, body in player.inbox["user"] if body
    ]
    assert [(one.message, one.is_late) for one in changes] == [("move", True)]


def test_accept_applies_only_goals_seen_by_the_handler(player: Player) -> None:
    player.module("arm", "command grasp", takes=["update"])
    player.declare("user", "command grasp")
    task = player.task("user", "grasp")
    player.change("user", task, "update", 8)
    player.change("user", task, "update", 9)
    player.change("arm/1", task, "accept", serial=2)
    grasp = player.central.tree.tasks[TaskId(task)]
    # The second update has no answer yet.
    assert (grasp.body, grasp.state) == (msgspec.msgpack.encode(8), "update requested")
    player.change("arm/1", task, "accept", serial=3)
    assert (grasp.body, grasp.state) == (msgspec.msgpack.encode(9), "running")


def test_result_sent_before_seeing_a_pause_is_accepted(player: Player) -> None:
    task = player.task("user", "walk")
    player.change("user", task, "pause")
    for _ in range(2 * MOST_ASKED):  # each result overtakes the pause once more
        *_, answer = player.change("feet/1", task, "result available", 5, serial=0)
        assert isinstance(answer, headers.Accepted)
        assert player.central.tree.tasks[TaskId(task)].state == "paused"
    changes = [fact.transition for fact in player.facts(StateChanged)]
    assert changes == ["pause", *["result available", "pause"] * 2 * MOST_ASKED]


@IN_PYTHON
def test_observing_too_many_tasks_is_refused(
    player: Player, monkeypatch: pytest.MonkeyPatch
) -> None:
    for _ in range(4):
        task = player.task("user", "walk")
    for limit in ("MOST_LATE", "MOST_SEARCHED"):
        with monkeypatch.context() as patched:
            patched.setattr(observing, limit, 4)
            assert not any(isinstance(one, headers.Refused) for one in player.observe("user"))
            patched.setattr(observing, limit, 3)
            (refused,) = player.observe("user")
            assert refused == headers.Refused(
                player.numbers["user"],
                Refusal.OVERLOAD,
                "there are 4 tasks: observe a message, what is under a task, or one task",
            )
            assert not any(
                isinstance(one, headers.Refused)
                for one in player.observe("user", task=TaskId(task))
            )
