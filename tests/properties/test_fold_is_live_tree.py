"""Folding the journal gives the live tree, after every event of a random life."""

from hypothesis import given, settings
from hypothesis import strategies as st
from properties.life import Life, operation

from tca_tools.history import History
from tca_wire.points import ALL_MOMENTS, ROOT


@given(st.lists(operation, max_size=50))
@settings(max_examples=400, deadline=None)
def test_folding_the_journal_gives_the_live_tree(operations: list[tuple[str, int, int, int, int]]) -> None:
    life, history, folded = Life(), History(), 0
    for name, *numbers in operations:
        life.do(name, *numbers)
        for entry in life.player.entries[folded:]:
            history.apply(entry)
        folded = len(life.player.entries)
        assert_same(life, history)


def assert_same(life: Life, history: History) -> None:
    live = life.central.tree.tasks
    unended = {task.id for task in history.tasks.values() if sum(task.reached) != ALL_MOMENTS}
    assert unended == set(live)
    for task_id, task in live.items():
        folded = history.tasks[task_id]
        assert sum(folded.reached) == task.reached
        assert folded.parent == (task.parent.id if task.parent else ROOT)
        assert (folded.killed or "") == task.killed
        assert task.killed or folded.is_suspended == task.suspended
        assert bool(folded.handling) == task.is_running
        assert folded.is_queued == (task.queues is not None)
        assert {child for child in folded.children if child in live} == set(task.children or {})
    attended = {delivery.message_id for delivery in life.central.dispatcher.attended.values()}
    assert {handling.message_id for handling in history.handlings if handling.end is None} == attended
