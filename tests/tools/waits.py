"""Runs in which something waits, told as stories."""

from tools.story import THIS, Story

from tca_wire.constraints import Constraint, sequential_achievement
from tca_wire.journal import facts
from tca_wire.points import Moment, Point, TaskId


def stuck(drills: int = 4) -> Story:
    """Drills one after the other; the handler of the first one waits for a calibration that nobody handles."""
    story = Story().module("brain", "mission").module("rig", "drill").at(1.0)
    mission = story.goal("mission", "user")
    story.delivered(mission, "brain").reached(mission, Moment.START_ACHIEVING)
    drill = story.command("drill", "brain", mission)
    story.delivered(drill, "rig").reached(drill, Moment.START_ACHIEVING).at(2.0)
    calibrate = story.command("calibrate", "rig", drill)
    story.queued(calibrate).say(facts.WaitBegan("rig", drill, TaskId(calibrate), Moment.END_ACHIEVING))
    for _ in range(drills - 1):
        drill = story.command("drill", "brain", mission, sequential_achievement(TaskId(max(drill, 2)), THIS))
    return story.returned(mission).at(5.0)


def delayed() -> Story:
    """Candles are lit three seconds after a bell, which is rung at 500 s."""
    story = Story().module("waiter", "ring bell", "light candles").at(1.0)
    at_500 = Constraint(Point(TaskId(0), Moment.END_ACHIEVING), Point(THIS, Moment.START_ACHIEVING), 500.25)
    bell = story.command("ring bell", "user", 0, at_500)
    later = Constraint(Point(TaskId(bell), Moment.END_ACHIEVING), Point(THIS, Moment.START_ACHIEVING), 3.0)
    story.command("light candles", "user", 0, later)
    return story.at(2.0)
