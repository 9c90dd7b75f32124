"""Test a planner with pytest: with a central in the test, and with a daemon.

``pytest 79_test_fetch.py`` runs the tests. Each has a central of its own.
"""

import sys

import pytest

from tca_module import Command, Failure, Goal, Module, Outcome, Task, TaskFailed, connect
from tca_module.testing import LocalCentral
from tca_tools.testing.daemon import DaemonOfTest

FETCH, GRASP = Goal("fetch", str), Command("grasp", str, result=float)
SLIPPED = Failure("slipped")
planner = Module("planner")


@planner.handles(FETCH)
def fetch(task: Task, thing: str) -> None:
    task.command(GRASP, thing, deadline=60)


def test_fetch_grasps_the_thing(tca_central: LocalCentral) -> None:
    grasp = tca_central.fake(GRASP, returns=0.3)  # in place of the hand
    tca_central.start(planner)
    assert planner.goal(FETCH, "cup").wait(timeout=5) is Outcome.DONE
    assert grasp.calls == ["cup"]


def test_fetch_fails_if_the_hand_slips(tca_central: LocalCentral) -> None:
    tca_central.fake(GRASP, fails=SLIPPED)
    tca_central.start(planner)
    with pytest.raises(TaskFailed, match="slipped"):
        planner.goal(FETCH, "cup").result(timeout=5)


def test_fetch_fails_after_a_minute_without_a_hand(tca_central: LocalCentral) -> None:
    tca_central.start(planner)
    fetch = planner.goal(FETCH, "cup")
    tca_central.advance(59)
    assert planner.tasks(FETCH)  # it still runs
    tca_central.advance(1)
    with pytest.raises(TaskFailed, match="timeout"):
        fetch.result(timeout=5)


def test_fetch_with_a_daemon(tca_daemon: DaemonOfTest) -> None:
    tca_daemon.fake(GRASP, returns=0.3)
    tca_daemon.start(planner)
    with connect("test") as user:
        assert user.goal(FETCH, "cup").wait(timeout=5) is Outcome.DONE


if __name__ == "__main__":
    sys.exit(pytest.main(["-q", "-Wignore", __file__]))
