"""Test the planner and the recovery. The body is a fake."""

from tca_module import Outcome
from tca_module.testing import LocalCentral

from messages import BLOCKED, DRIVE, FILL, POUR, WATER, Plant, Way
from planner import planner
from recovery import recovery

PALM = Plant("palm", "study", 0.8)
HALL, GARDEN = Way("study", through="hall"), Way("study", through="garden")


def test_robot_pours_what_the_plant_needs(tca_central: LocalCentral) -> None:
    tca_central.fake(DRIVE)
    tca_central.fake(FILL)
    pour = tca_central.fake(POUR)
    tca_central.start(planner)
    watering = planner.goal(WATER, PALM)
    tca_central.advance(5)
    assert watering.wait(timeout=5) is Outcome.DONE
    assert pour.calls == [0.8]


def test_can_is_filled_after_the_start_of_the_drive(tca_central: LocalCentral) -> None:
    drive = tca_central.fake(DRIVE, returns=lambda task, _way: task.sleep(1))
    fill = tca_central.fake(FILL)
    pour = tca_central.fake(POUR)
    tca_central.start(planner)
    planner.goal(WATER, PALM)
    tca_central.advance(0.5)  # planned; the drive has begun
    assert (drive.calls, fill.calls) == ([HALL], [])
    tca_central.advance(0.3)
    assert (fill.calls, pour.calls) == ([0.8], [])
    tca_central.advance(0.7)  # the end of the drive
    assert pour.calls == [0.8]


def test_blocked_drive_is_retried_through_the_garden(tca_central: LocalCentral) -> None:
    drive = tca_central.fake(DRIVE, returns=[BLOCKED(HALL), None])
    tca_central.start(recovery)
    driving = recovery.command(DRIVE, HALL)
    assert driving.wait(timeout=5) is Outcome.DONE
    assert drive.calls == [HALL, GARDEN]
