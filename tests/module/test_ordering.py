"""The order of children. The constraints of the next child are tested alone and in blocks."""

import pytest

from tca_module.sending.sibling_order import SiblingOrder
from tca_wire.constraints import Flags
from tca_wire.points import ROOT, THIS, TaskId


class Plan:
    """A sender of numbered children, which returns the flags and constraints of each child."""

    def __init__(self, *, is_shared: bool = False) -> None:
        self.ordering = SiblingOrder(is_shared=is_shared)
        self.newest = 0
        self.epoch = "one"

    def child(self, *, is_goal: bool = True, sequential: bool = True) -> str:
        flags, constraints = self.ordering.place(self.epoch, is_goal=is_goal, sequential=sequential)
        self.newest += 1
        self.ordering.add(TaskId(self.newest), sequential=sequential)
        words = [
            flag.name.lower().replace("_", " ") for flag in Flags if flag in flags and flag.name
        ]
        for constraint in constraints:
            assert constraint.after.task == THIS
            words.append(str(constraint).replace("this task", "it"))
        return ", ".join(words)


@pytest.fixture
def plan() -> Plan:
    return Plan()


def after(*tasks: int) -> str:
    return ", ".join(f"end achieving task {task} <= start achieving it" for task in tasks)


def planned_after(task: int) -> str:
    return f"start achieving task {task} <= start planning it"


def test_children_are_sequential_by_default(plan: Plan) -> None:
    assert plan.child() == "seq ach"
    assert plan.child(sequential=False) == ""
    assert plan.child() == "seq ach"


def test_parallel_block_is_unordered_inside_and_ordered_outside(plan: Plan) -> None:
    plan.child()
    with plan.ordering.parallel():
        assert plan.child() == "seq ach"
        assert plan.child() == after(1)
        assert plan.child() == after(1)
    assert plan.child() == after(2, 3, 4)
    assert plan.child() == "seq ach"


def test_first_parallel_block_waits_for_nothing(plan: Plan) -> None:
    with plan.ordering.parallel():
        assert [plan.child(), plan.child()] == ["", ""]
    assert plan.child() == after(1, 2)


def test_nested_blocks_combine_their_orders(plan: Plan) -> None:
    with plan.ordering.parallel():
        with plan.ordering.sequence():
            assert [plan.child(), plan.child()] == ["", "seq ach"]
        with plan.ordering.sequence():
            assert [plan.child(), plan.child()] == ["", "seq ach"]
            with plan.ordering.parallel():
                assert [plan.child(), plan.child()] == ["seq ach", after(4)]
        plan.child()
    assert plan.child() == after(2, 5, 6, 7)


def test_empty_block_changes_no_order(plan: Plan) -> None:
    plan.child()
    with plan.ordering.sequence(), plan.ordering.parallel():
        pass
    assert plan.child() == "seq ach"


def test_unordered_child_still_belongs_to_its_block(plan: Plan) -> None:
    with plan.ordering.sequence():
        plan.child()
        assert plan.child(sequential=False) == ""
        assert plan.child() == after(1, 2)
    assert plan.child() == "seq ach"


def test_planning_runs_at_most_one_sibling_ahead(plan: Plan) -> None:
    with plan.ordering.sequence(1):
        assert plan.child() == ""
        assert plan.child() == f"seq ach, {planned_after(1)}"
        assert plan.child() == f"seq ach, {planned_after(2)}"
    assert plan.child() == "seq ach"


def test_planning_runs_at_most_n_siblings_ahead(plan: Plan) -> None:
    with plan.ordering.sequence(2):
        assert [plan.child(), plan.child()] == ["", "seq ach"]
        assert plan.child() == f"seq ach, {planned_after(1)}"
        assert plan.child() == f"seq ach, {planned_after(2)}"


def test_sequence_of_zero_delays_all_planning(plan: Plan) -> None:
    with plan.ordering.sequence(0):
        plan.child()
        assert plan.child() == "seq ach, delay planning"
        with plan.ordering.parallel():
            assert plan.child() == "seq ach, delay planning"
    assert plan.child() == "seq ach"


def test_unplanned_command_counts_as_sibling_ahead(plan: Plan) -> None:
    with plan.ordering.sequence(1):
        plan.child()
        assert plan.child(is_goal=False) == "seq ach"
        assert plan.child() == f"seq ach, {planned_after(2)}"


def test_block_counts_as_one_sibling_ahead(plan: Plan) -> None:
    with plan.ordering.sequence(1):
        with plan.ordering.parallel():
            plan.child(), plan.child()
        assert plan.child() == f"{after(1, 2)}, {planned_after(1)}, {planned_after(2)}"
        with plan.ordering.sequence():
            assert plan.child() == f"seq ach, {planned_after(3)}"
            assert plan.child() == f"seq ach, {planned_after(3)}"
        assert plan.child() == f"seq ach, {planned_after(4)}"


def test_root_block_names_its_siblings_explicitly() -> None:
    plan = Plan(is_shared=True)  # the last sibling may be another thread's
    assert [plan.child(), plan.child()] == ["seq ach", "seq ach"]
    with plan.ordering.sequence():
        assert [plan.child(), plan.child()] == [after(2), after(3)]


def test_exception_ends_block(plan: Plan) -> None:
    def fail() -> None:
        with plan.ordering.parallel():
            plan.child()
            plan.child()
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert plan.child() == after(1, 2)


def test_children_of_former_epoch_order_nothing(plan: Plan) -> None:
    plan.child()
    with plan.ordering.parallel():
        plan.child()
        plan.epoch = "two"
        plan.child()
    assert plan.child() == "seq ach"
    assert ROOT == 0
