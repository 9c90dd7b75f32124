"""The missions for one turtle, on a stepped clock."""

import math

import pytest
from turtles.towns import bounded, carry_out, started, town

from robots.turtle_sim.__main__ import ShowIsOver, ShownMission
from robots.turtle_sim.missions.background import background
from robots.turtle_sim.missions.interrupted import interrupted
from robots.turtle_sim.missions.letters import A, C, T, letters
from robots.turtle_sim.missions.patrol import patrol
from robots.turtle_sim.missions.too_far import too_far
from robots.turtle_sim.world import Pose
from tca_behaviours.missions import ConditionVerified, Mission
from tca_behaviours.missions.console.names import ConsoleNames


def test_patrol_mission_visits_its_goals() -> None:
    with town() as there:
        carry_out(there, bounded(there, 7, patrol))
        assert started(there)[:7] == ["Wait", "GoTo", "Wait", "GoTo", "Wait", "GoTo", "Wait"]
        assert not there.server.runs


def test_mission_reports_a_goal_that_is_too_far(capsys: pytest.CaptureFixture[str]) -> None:
    with town() as there:
        carry_out(there, too_far)
        assert started(there) == ["Wait", "GoTo", "GoTo"]
        assert math.dist(there.place, (5.0, 5.0)) < 0.11
    said = capsys.readouterr().out
    assert said.startswith("Task failed with error status: 136: GoTo {")
    assert "timeout: it ran for 3 s" in said


def test_mission_runs_tasks_in_the_background() -> None:
    with town(Pose(5.5, 6.0)) as there:
        assert carry_out(there, background) == "the right one"
        assert started(there) == ["WaitForROI", "WaitForROI", "GoTo", "GoTo"]
        assert math.dist(there.place, (1.0, 6.0)) < 0.11


def test_patrol_is_interrupted_in_the_region() -> None:
    with town(Pose(4.0, 6.0, theta=math.pi)) as there:
        carry_out(there, interrupted)
        assert started(there) == ["WaitForROI", "Wait", "GoTo", "Constant"]
        assert math.dist(there.place, (2.0, 6.0)) < 0.3


def test_patrol_is_not_interrupted_outside_the_region() -> None:
    with town(Pose(4.0, 6.0)) as there:
        carry_out(there, lambda mission: interrupted(mission, 9.0, 6.0))
        assert started(there) == ["WaitForROI", "Wait", "GoTo"]
        assert math.dist(there.place, (9.0, 6.0)) < 0.11
        assert not there.server.runs


def test_mission_clears_the_sheet() -> None:
    with town() as there:
        end = carry_out(there, lambda mission: mission.Clear(header={"frame_id": "Hello"}))
        assert end.text == "got an extra header, frame_id=Hello"


def test_console_runs_turtle_tasks() -> None:
    shown = list[str]()

    def type_lines(mission: Mission) -> None:
        names = ConsoleNames(mission, shown.append).names
        for line in ("index()", "help(GoTo)", "GoTo(goal_x=5.0,goal_y=5.0)", "status()"):
            exec(line, names)

    with town() as there:
        carry_out(there, type_lines)
        assert math.dist(there.place, (5.0, 5.0)) < 0.11
    assert "GoTo        Reach a desired destination." in shown
    assert any(
        "dist_threshold" in text and "Distance at which the target is considered reached" in text
        for text in shown
    )
    assert any(text.startswith("GoTo {") and "completed" in text for text in shown)


def test_end_of_a_show_ends_a_mission_with_conditions() -> None:
    is_over = ShowIsOver()

    def never_ends(mission: Mission) -> None:
        mission.clear_conditions()
        mission.Wait(foreground=False, duration=1.0)
        is_over.reason = "another has failed"
        mission.Wait(duration=1e6)

    with town() as there:
        shown = ShownMission("turtle", there.central, 0.0, is_over)
        with pytest.raises(ConditionVerified):
            carry_out(there, never_ends, opened=shown)
        assert not there.server.runs


@pytest.mark.soak
def test_mission_draws_letters() -> None:
    with town() as there:
        carry_out(there, letters)
        drawn = [(stroke.points[0], stroke.points[-1]) for stroke in there.world.strokes]
        wanted = [(stroke[0], stroke[-1]) for letter in (T, C, A) for stroke in letter]
        for ends, places in zip(drawn, wanted, strict=True):
            assert [math.dist(*pair) < 0.1 for pair in zip(ends, places, strict=True)] == [
                True,
                True,
            ]
