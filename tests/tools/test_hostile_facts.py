"""Facts that contradict each other: a fold takes any."""

from tca_tools.journal.fold import History
from tca_wire.journal import facts
from tca_wire.points import TaskId


def test_a_failure_may_be_caught_by_what_is_no_task() -> None:
    history = History()
    caught = facts.Caught(TaskId(1), TaskId(0), TaskId(0), 1)
    history.apply(facts.Entry(1, 1.0, [caught, facts.Recovered(TaskId(1))]))
    assert not history.tasks[TaskId(1)].is_recovering
