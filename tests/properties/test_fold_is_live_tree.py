"""Folding the journal gives the live tree, after every event of a random life."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from properties.folded import FoldedPlayer
from properties.life import Life, operation

from tca_central.core import Central
from tca_tools.run.fold import History
from tca_wire.constraints import Flags
from tca_wire.packets import headers
from tca_wire.points import ALL_MOMENTS, ROOT, TaskId


class LivePlayer(FoldedPlayer):
    """Looks whether the fold gives the live tree."""

    def compare(self) -> None:
        assert_same(self.central, self.history)


@given(st.lists(operation, max_size=50))
@settings(max_examples=80)
def test_folding_the_journal_gives_the_live_tree(operations: list[tuple[str, int, int, int, int]]) -> None:
    life = Life(LivePlayer())
    for name, *numbers in operations:
        life.do(name, *numbers)


@given(st.integers(0, 1 << 32))
@settings(max_examples=2)
def test_folding_the_journal_of_thousands_of_events_gives_the_live_tree(seed: int) -> None:
    Life(LivePlayer()).go_on(seed, 2_000)


@pytest.mark.soak
@given(st.integers(0, 1 << 32))
@settings(max_examples=30)
def test_folding_many_long_journals_gives_the_live_tree(seed: int) -> None:
    Life(LivePlayer()).go_on(seed, 5_000)


def assert_same(central: Central, history: History) -> None:
    live = central.tree.tasks
    unended = {task.id for task in history.tasks.values() if sum(task.reached) != ALL_MOMENTS}
    assert unended == set(live)
    for task_id, task in live.items():
        folded = history.tasks[task_id]
        assert sum(folded.reached) == task.reached
        assert folded.parent == (task.parent.id if task.parent else ROOT)
        assert (folded.why_killed or "") == task.killed
        assert task.killed or bool(folded.suspension) == task.suspended
        assert bool(folded.handling) == task.is_running
        if folded.parent != ROOT and not task.killed and not task.retrying:  # one at the top has those under it, too
            assert folded.failure.partition(":")[0] == (task.failure[0] if task.failure else "")
            assert not task.failure or folded.is_dealt_with == task.is_dealt_with
        assert folded.is_queued == (task.queues is not None)
        assert {child for child in folded.children if child in live} == set(task.children or {})
    attended = {delivery.message_id for delivery in central.dispatcher.running.values()}
    assert {handling.message_id for handling in history.handlings if handling.end is None} == attended


def test_a_retried_task_waits_under_a_new_number() -> None:
    player = LivePlayer()
    player.module("legs", "command move")
    player.module("user")
    player.declare("user", "command move")
    first = player.task("user", "move")
    player.send("user", "move", flags=Flags.NONE, priority=1)
    player.receive("user", headers.Retry(player.number("user"), TaskId(first)))
    player.reply("legs/1")
    assert player.history.tasks[TaskId(first)].is_queued
