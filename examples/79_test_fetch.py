"""Test a planner with pytest: once with a daemon, once without, with a clock that the test steps.

``pytest 79_test_fetch.py`` runs the tests. Each has a central of its own.
"""

import sys

import pytest

from tca_module import Command, Goal, Module, Outcome, Task, TaskFailed, connect
from tca_module.testing import LocalCentral
from tca_tools.testing.daemon import DaemonOfTest

FETCH, GRASP = Goal("fetch", str), Command("grasp", str)
planner = Module("planner")


@planner.handles(FETCH)
def fetch(task: Task, thing: str) -> None:
    task.command(GRASP, thing, deadline=60)


def test_fetch_grasps_the_thing(tca_daemon: DaemonOfTest) -> None:
    grasp = tca_daemon.fake(GRASP)
    tca_daemon.start(planner)
    with connect("test") as user:
        assert user.goal(FETCH, "cup").wait(timeout=5) is Outcome.DONE
    assert grasp.calls == ["cup"]


def test_fetch_fails_after_a_minute_without_a_hand(tca_central: LocalCentral) -> None:
    tca_central.start(planner)
    fetch = planner.goal(FETCH, "cup")
    tca_central.advance(59)
    assert planner.tasks(FETCH)  # it still runs
    tca_central.advance(1)
    with pytest.raises(TaskFailed, match="timeout"):
        fetch.result(timeout=5)


if __name__ == "__main__":
    sys.exit(pytest.main(["-q", "-Wignore", __file__]))
