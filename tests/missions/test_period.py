"""Periodic tasks do not drift, and overruns are counted and logged."""

import logging

import pytest
from hypothesis import given
from hypothesis import strategies as st
from missions.gripper import Gripper, serving

from tca_behaviours.missions import PeriodicTask, Status, parameter
from tca_module.period import Period


class Slow(PeriodicTask[Gripper]):
    """Take the given time for each step."""

    takes: list[float] = parameter([], "Seconds")

    def initialise(self) -> None:
        self.left = list(self.takes)

    def iterate(self) -> Status:
        self.env.note(self, "steps")
        self.sleep(self.left.pop(0))
        return Status.RUNNING if self.left else Status.COMPLETED


@pytest.mark.parametrize(
    ("takes", "begins", "overruns"),
    [
        ([0.02, 0.09, 0.05, 0], [0, 0.1, 0.2, 0.3], 0),
        (
            [0.13, 0, 0, 0],
            [0, 0.13, 0.2, 0.3],
            1,
        ),  # the late step starts at once, and the grid is kept
        ([0.35, 0, 0], [0, 0.35, 0.4], 3),  # two steps are skipped
        ([0.1, 0, 0], [0, 0.1, 0.2], 0),
    ],
)
def test_overruns_are_counted_and_logged_once(
    takes: list[float], begins: list[float], overruns: int, caplog: pytest.LogCaptureFixture
) -> None:
    with serving(Slow) as robot, caplog.at_level(logging.WARNING, "tca.gripper"):
        sent = robot.send("Slow", takes=takes)
        assert robot.after(2) == [f"{begin:.2f} Slow steps" for begin in begins]
        assert sent.result().overruns == overruns
        warning = f"gripper.Slow {{1}} misses its period of 0.1 s: an iteration ended {takes[0]:g} s after it was due"
        assert caplog.text.count(warning) == (overruns > 0)


@given(st.lists(st.floats(0, 0.5), max_size=50), st.floats(0.01, 0.2))
def test_period_keeps_its_grid_for_any_iteration_times(takes: list[float], seconds: float) -> None:
    period, now = Period(5.0, seconds), 5.0
    for number, each in enumerate(takes, 1):
        start, now = period.due, max(now, period.due) + each
        due = period.next(now, seconds)
        assert due > start
        assert due >= now - seconds - 1e-9  # a late step starts at once, at most one period late
        assert round((due - 5.0) / seconds, 6) == round((due - 5.0) / seconds)
        assert due <= max(now, start) + seconds + 1e-9
        assert round((due - 5.0) / seconds) >= number


def test_changed_period_counts_from_the_current_iteration() -> None:
    period = Period(0.0, 0.1)
    assert period.next(0.0, 0.1) == 0.1
    assert period.next(0.1, 0.5) == 0.6
    assert period.next(0.6, 0.5) == 1.1
    assert period.missed == 0
