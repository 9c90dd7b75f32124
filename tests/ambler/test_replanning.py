"""Alternative moves for a leg that met an obstacle."""

import math
from dataclasses import replace

import numpy as np
import pytest
from ambler.builders import a_map, a_stance, a_step

from robots.ambler_sim.errors import NoFootfall, PathBlocked
from robots.ambler_sim.geometry import leg_joints
from robots.ambler_sim.planning.checks import is_stable, margins_of_leg_move
from robots.ambler_sim.planning.elevation import height_at, with_obstacles
from robots.ambler_sim.planning.footfall import choose_foothold
from robots.ambler_sim.planning.gait import next_leg, standard_feet, standard_places, with_foot
from robots.ambler_sim.planning.leg_recovery import RECOVERY_RADIUS, plan_leg_move, swing_path
from robots.ambler_sim.planning.replanning import (
    FOOT_ROOM,
    OBSTACLE_RADIUS,
    RAISE,
    another_way,
    centring_move,
    obstacle_at,
    raised_move,
    shuffle,
)
from robots.ambler_sim.planning.stability import conservative_margin
from robots.ambler_sim.vocabulary import Contact, Foot, LegMove, Obstacle, Stance


def wall(x: float, y: float) -> Obstacle:
    return Obstacle(x, y, 0.5, OBSTACLE_RADIUS, is_wall=True)


def bad_place(x: float, y: float) -> Obstacle:
    return Obstacle(x, y, 0.0, FOOT_ROOM, is_wall=False)


STEP = a_step()
LEG_MOVE = plan_leg_move(a_map(), STEP, STEP.ideal)
AHEAD_OF_THE_SHAFT = wall(1.15, 1.0)


def way_of(move: LegMove, stance: Stance) -> np.ndarray:
    foot = stance.feet[move.leg]
    start, end = leg_joints(stance.pose, foot), leg_joints(stance.pose, move.foothold)
    turn = math.remainder(end[0] - start[0], math.tau)
    turn += move.sense * math.tau if move.sense * turn < 0 else 0.0
    return swing_path(stance.pose, move.leg, start[:2], (start[0] + turn, end[1]), move.radius)


def test_raised_move_changes_only_the_lift() -> None:
    contact = Contact(2, 1.0, 1.5, LEG_MOVE.lift, 3000.0)
    higher = raised_move(LEG_MOVE, STEP.before, contact)
    assert higher == replace(LEG_MOVE, lift=LEG_MOVE.lift + RAISE)


def test_leg_is_not_raised_beyond_its_limit() -> None:
    with pytest.raises(PathBlocked, match=r"leg 2 .* lifted to 3\.40 m, .* 3\.20 m"):
        raised_move(LEG_MOVE, STEP.before, Contact(2, 1.0, 1.5, 3.0, 3000.0))


def test_felt_wall_lies_beyond_the_contact() -> None:
    met = obstacle_at(Contact(2, 1.0, 1.0, 0.5, 900.0, 0.0, 1.0))
    assert met.is_wall
    assert (met.x, met.y) == pytest.approx((1.0, 1.05 + OBSTACLE_RADIUS))


def test_felt_rock_under_the_foot_is_no_foothold() -> None:
    assert obstacle_at(Contact(2, 1.4, 2.2, 0.3, 9000.0)) == Obstacle(
        1.4, 2.2, 0.3, FOOT_ROOM, is_wall=False
    )


def test_obstacles_change_only_their_own_map_cells() -> None:
    ground = with_obstacles(a_map(), [wall(1.0, 1.0), bad_place(-1.0, 1.0)])
    assert height_at(ground, 1.0, 1.0) == math.inf
    assert math.isnan(height_at(ground, -1.0, 1.0))
    assert height_at(ground, 1.0 + OBSTACLE_RADIUS + 0.1, 1.0) == 0.0


def test_leg_swings_around_a_wall() -> None:
    ground = with_obstacles(a_map(), [AHEAD_OF_THE_SHAFT])
    move = another_way(ground, STEP)
    assert move.radius > RECOVERY_RADIUS
    assert move.lift == pytest.approx(LEG_MOVE.lift)
    away = np.hypot(*(way_of(move, STEP.before) - (AHEAD_OF_THE_SHAFT.x, AHEAD_OF_THE_SHAFT.y)).T)
    assert away.min() > OBSTACLE_RADIUS


def test_blocked_foothold_is_replaced_by_another() -> None:
    bad = choose_foothold(a_map(), STEP)
    move = another_way(with_obstacles(a_map(), [bad_place(bad.x + 0.2, bad.y)]), STEP)
    assert math.dist((move.foothold.x, move.foothold.y), (bad.x + 0.2, bad.y)) > OBSTACLE_RADIUS


def test_leg_past_the_nose_takes_the_short_way() -> None:
    before = with_foot(STEP.before, Foot(2, 1.1, 1.3, 0.0))
    assert another_way(a_map(), replace(STEP, before=before)).sense == 0
    assert another_way(a_map(), STEP).sense == 1


def test_missing_way_raises_path_blocked_or_no_footfall() -> None:
    ring = [wall(x, 1.0) for x in (1.0, 1.6, 2.2)]
    with pytest.raises(PathBlocked, match="leg 2 finds no way to"):
        another_way(with_obstacles(a_map(), ring), STEP)
    everywhere = [bad_place(x, y) for x in (1.0, 1.5, 2.0) for y in (1.8, 2.3, 2.8)]
    with pytest.raises(NoFootfall):
        another_way(with_obstacles(a_map(), everywhere), STEP)


def test_legs_keep_their_order_in_the_standard_configuration() -> None:
    stance = with_foot(a_stance(), Foot(2, 1.5, 2.3, 0.0))  # in front of legs 0 and 1
    places = standard_places(stance, first=0)
    assert [(place.leg, place.x) for place in places] == [
        (0, -0.5),
        (1, -1.5),
        (2, 0.5),
        (3, 1.0),
        (4, 0.0),
        (5, -1.0),
    ]


def test_standard_configuration_may_be_mirrored() -> None:
    left, right = standard_places(a_stance(), first=1), standard_places(a_stance(), first=4)
    assert left == standard_feet(a_stance().pose, 0.0)
    assert [place.x for place in right] == [1.0, 0.0, -1.0, 0.5, -0.5, -1.5]


def test_leg_half_way_returns_to_the_rear_of_its_stack() -> None:
    stance = with_foot(a_stance(), Foot(2, 0.9, 0.4, 0.0))
    back = next(move for move in shuffle(a_map(), stance, blocked=2) if move.leg == 2)
    assert back.sense == -1
    assert (back.foothold.x, back.foothold.y) == pytest.approx((-1.0, 2.3))


def test_shuffle_is_stable_and_moves_the_blocked_leg_last() -> None:
    stance = with_foot(a_stance(), Foot(2, -1.2, 1.4, 0.0))
    moves = shuffle(a_map(), stance, blocked=2)
    assert sorted(move.leg for move in moves) == list(range(6))
    assert moves[-1].leg == 2
    for move in moves:
        assert is_stable(margins_of_leg_move(stance, move))
        stance = with_foot(stance, move.foothold)
    assert next_leg(replace(stance, last_leg=2)) in (3, 4, 5)
    assert shuffle(a_map(), stance, blocked=2) == []


def test_foot_without_a_way_stays_during_shuffle() -> None:
    stance = with_foot(a_stance(), Foot(2, 0.9, 0.4, 0.0))
    walls = [wall(-0.6, y / 2) for y in range(-6, 8)]
    assert 2 not in {
        move.leg for move in shuffle(with_obstacles(a_map(), walls), stance, blocked=2)
    }


def test_centring_moves_the_body_where_any_leg_can_be_lifted() -> None:
    assert centring_move(a_stance()) is None
    badly = a_stance()
    badly = replace(badly, pose=replace(badly.pose, x=0.6))
    move = centring_move(badly)
    assert move is not None
    assert conservative_margin(badly) < 0.0
    assert conservative_margin(replace(badly, pose=move.goal)) > 0.2
