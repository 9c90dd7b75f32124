"""Steering of very many tasks, deep or wide: without recursion, and with nothing left behind."""

import pytest
from central.player import Player, before, point

from dev.benchmarks.core_control import Steered
from dev.benchmarks.core_events import USER
from tca_central.model.tasks import Task
from tca_wire.constraints import Flags
from tca_wire.journal.facts import Constrained
from tca_wire.packets.changes import Observe
from tca_wire.packets.headers import Kill
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import Scope

START = Moment.START_ACHIEVING


@pytest.mark.parametrize("size", [8_000, pytest.param(100_000, marks=pytest.mark.soak)])
@pytest.mark.parametrize("deep", [False, True], ids=["wide", "deep"])
def test_all_operations_on_big_tree_leave_nothing_behind(deep: bool, size: int) -> None:
    bench = Steered()
    bottom = bench.grow(size, deep=deep)
    bench.steady(bottom, 10)
    bench.operations(bottom)
    assert len(bench.central.tree.tasks) == 2  # the top-level task and its termination message
    assert not bench.central.dispatcher.to_refill


def test_observer_of_long_chain_searches_no_ancestors(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bench, looked = Steered(), list[int]()
    bench.grow(2_000, deep=True)
    monkeypatch.setattr(Task, "find_above", lambda task, _: looked.append(task.id))
    bench.event(USER, Observe(bench.next(), below=TaskId(bench.top)))
    assert len(bench.central.observers.of_many) == 1
    assert not looked


@pytest.mark.parametrize("scope", [Scope.TASK, Scope.DESCENDANTS])
def test_kill_of_long_sequence_adds_linear_number_of_constraints(scope: Scope) -> None:
    """The follower still waits for the running step; the steps between are dropped."""
    player = Player.of("planner: goal walk", "legs: command move", "user", check=False)
    walk = player.task("user", "walk")
    for _ in range(2_000):
        last = player.task("planner", "move", under=walk)
    follower = player.task(
        "user",
        "move",
        flags=Flags.NONE,
        constraints=(before(point(last, Moment.END_ACHIEVING), point(-1, START)),),
    )
    mark = len(player.entries)
    player.request("user", Kill, TaskId(walk), scope=scope)
    made = [fact for entry in player.entries[mark:] for fact in entry.facts]
    assert sum(len(fact.constraints) for fact in made if isinstance(fact, Constrained)) <= 2 * 2_000
    task = player.central.tree.tasks[TaskId(follower)]
    assert not task.reached & START
    player.reply("legs/1", walk + 1)
    assert task.reached & START
