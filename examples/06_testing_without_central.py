"""Your modules' tests need no daemon: LocalCentral is the real core in the process of the test."""

from tca_module import Command, Goal, Module, Outcome, Task
from tca_module.testing import LocalCentral

FETCH, GRASP = Goal("fetch", str), Command("grasp", str)


def make_planner(central: LocalCentral) -> Module:
    planner = Module("planner", central)

    @planner.handles(FETCH)
    def fetch(task: Task, thing: str) -> None:
        task.command(GRASP, thing)

    return planner


def test_fetching_is_grasping() -> None:
    grasped = []
    with LocalCentral() as central:
        hand = Module("hand", central)
        hand.handles(GRASP)(lambda _, thing: grasped.append(thing))
        planner = make_planner(central)
        with planner.running(), hand.running():
            assert planner.goal(FETCH, "cup").wait(timeout=5) is Outcome.DONE
    assert grasped == ["cup"]


if __name__ == "__main__":
    test_fetching_is_grasping()
    print("passed")
