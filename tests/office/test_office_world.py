"""The lab without any program: cups, people, the robot's hand and battery, and paths."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robots.office_sim.modules.vision import PATIENCE, CupTracks
from robots.office_sim.paths import RADIUS, NoPath, is_clear, path_to
from robots.office_sim.vocabulary import (
    Approach,
    Block,
    CupState,
    FloorPlan,
    Grasped,
    LabScene,
    Spot,
)
from robots.office_sim.world import CHARGING, DRIVING, SPEED, OfficeWorld

SEEDS = st.integers(0, 10_000)


def states(scene: LabScene) -> list[CupState]:
    return [cup.state for cup in scene.cups]


def drive(world: OfficeWorld, to: Spot, within: float = 0.0) -> None:
    seconds = world.drive(path_to(world.floor, world.robot, Approach(to, within)))
    world.advance(world.time + seconds)


@given(SEEDS, st.lists(st.floats(0.01, 50.0), max_size=8))
def test_people_move_the_same_however_often_they_are_polled(seed: int, looks: list[float]) -> None:
    one, other = OfficeWorld(seed, 100.0), OfficeWorld(seed, 100.0)
    for time in itertools.accumulate(looks):
        one.advance(time)
    end = sum(looks)
    other.advance(end)
    assert one.time == pytest.approx(end)
    if all(
        abs(end - float(line.split()[0])) > 0.2
        for line in (*one.scene().happened, *other.scene().happened)
    ):
        assert states(one.scene()) == states(other.scene())
    assert [cup.spot for cup in one.scene().cups] == [cup.spot for cup in other.scene().cups]


@given(SEEDS)
def test_robot_reaches_each_cup_and_the_charger_without_contact(seed: int) -> None:
    world = OfficeWorld(seed, 120.0)
    floor = world.floor
    for spot in (floor.bin, floor.charger, *(cup.spot for cup in world.scene().cups)):
        way = [world.robot, *path_to(floor, world.robot, Approach(spot, 0.45))]
        assert way[-1].to(spot) <= 0.45 + 1e-9
        for here, there in itertools.pairwise(way):
            assert all(
                is_clear(here, there, block.grown(RADIUS - 1e-6))
                for block in (*floor.walls, *floor.tables)
            )


def test_path_leads_along_the_corners_of_obstacles() -> None:
    floor = FloorPlan(10.0, 6.0, [], [Block(4.0, 2.0, 6.0, 4.5)], Spot(1, 1), Spot(9, 1))
    way = path_to(floor, Spot(1.0, 3.0), Approach(Spot(9.0, 3.0)))
    assert [(round(spot.x, 2), round(spot.y, 2)) for spot in way] == [
        (3.68, 1.68),
        (6.32, 1.68),
        (9.0, 3.0),
    ]
    assert path_to(floor, Spot(1.0, 3.0), Approach(Spot(2.0, 3.0), 0.4)) == [Spot(1.6, 3.0)]
    assert path_to(floor, Spot(1.0, 3.0), Approach(Spot(1.2, 3.0), 0.4)) == []


def test_no_path_leads_through_a_closed_wall() -> None:
    floor = FloorPlan(10.0, 6.0, [Block(5.0, 0.0, 5.2, 6.0)], [], Spot(1, 1), Spot(9, 1))
    with pytest.raises(NoPath, match=r"nothing leads to \(9.00, 3.00\)"):
        path_to(floor, Spot(1.0, 3.0), Approach(Spot(9.0, 3.0)))


def test_driving_takes_time_and_charge() -> None:
    world = OfficeWorld(1, 1.0)
    start = world.robot
    seconds = world.drive([Spot(start.x - 1.0, start.y), Spot(start.x - 1.0, start.y + 2.0)])
    assert seconds == pytest.approx(3.0 / SPEED)
    world.advance(1.0 / SPEED)
    assert world.robot.to(Spot(start.x - 1.0, start.y)) < 1e-6
    world.advance(seconds)
    assert world.robot.to(Spot(start.x - 1.0, start.y + 2.0)) < 1e-6
    assert world.battery == pytest.approx(1.0 - DRIVING * seconds)


def test_robot_with_a_flat_battery_stops_until_charged() -> None:
    world = OfficeWorld(1, 1.0, battery=0.02)
    assert world.dock() is None
    drive(world, world.floor.bin)
    assert world.battery == 0
    assert world.robot.to(world.floor.bin) > 3.0
    world = OfficeWorld(1, 1.0, battery=0.1)
    drive(world, world.floor.charger)
    seconds = world.dock()
    assert seconds is not None
    assert seconds == pytest.approx(0.9 / CHARGING, rel=0.02)
    world.advance(world.time + seconds + 0.1)
    assert world.battery > 0.99
    assert world.scene().charges == 1


def test_slipped_cup_is_grasped_again_and_dropped_into_the_bin() -> None:
    world = OfficeWorld(2, 1.0)
    world.advance(5.0)
    (cup,) = world.scene().cups
    assert cup.state is CupState.FLOOR
    assert world.close_fingers(cup.spot) is Grasped.NOTHING  # out of reach
    drive(world, cup.spot, 0.4)
    while (closed := world.close_fingers(cup.spot)) is Grasped.SLIPPED:
        pass
    assert closed is Grasped.CUP
    assert world.close_fingers(cup.spot) is Grasped.NOTHING  # the hand is full
    assert world.open_fingers()
    assert not world.open_fingers()
    (cup,) = world.scene().cups
    assert (cup.state, cup.spot) == (CupState.FLOOR, world.robot)
    assert world.close_fingers(cup.spot) is Grasped.CUP
    drive(world, world.floor.bin, 0.4)
    world.open_fingers()
    assert states(world.scene()) == [CupState.BIN]
    carried = [stretch for stretch in world.scene().trail if stretch.with_cup]
    assert len(carried) == 2


def test_people_take_cups_away() -> None:
    world = OfficeWorld(1, 300.0)
    world.advance(600.0)
    assert set(states(world.scene())) == {CupState.FLOOR, CupState.TAKEN}
    assert len(world.seen_spots()) <= states(world.scene()).count(CupState.FLOOR)


def test_cup_is_out_of_view_after_some_pictures_without_it() -> None:
    tracks = CupTracks()
    tracks.see([Spot(1.0, 1.0), Spot(3.0, 1.0)])
    tracks.see([Spot(3.02, 1.01)])
    tracks.see([Spot(1.01, 0.99), Spot(3.0, 1.0)])
    assert [cup.number for cup in tracks.cups] == [1, 2]
    for _ in range(PATIENCE - 1):
        tracks.see([Spot(3.0, 1.0)])
    assert [cup.number for cup in tracks.cups] == [1, 2]
    tracks.see([Spot(3.0, 1.0), Spot(5.0, 1.0)])
    assert [cup.number for cup in tracks.cups] == [2, 3]
    tracks.see([Spot(1.0, 1.0)])
    assert [cup.number for cup in tracks.cups] == [2, 3, 4]
