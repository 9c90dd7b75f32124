"""Checks of moves and footfalls."""

from dataclasses import replace

import pytest
from ambler.builders import a_map, a_stance, a_step

from robots.ambler_sim.planning.checks import (
    LEAST_ENERGY,
    LEAST_SUPPORT,
    Margins,
    fault_of_footfall,
    is_stable,
    margins_of_body_move,
    margins_of_leg_move,
)
from robots.ambler_sim.planning.gait import plan_body_move, with_foot
from robots.ambler_sim.planning.leg_recovery import plan_leg_move
from robots.ambler_sim.vocabulary import BodyMove, Foot, Pose, Readings

STEP = a_step()
LEG_MOVE = plan_leg_move(a_map(), STEP, STEP.ideal)
LANDED = with_foot(STEP.before, LEG_MOVE.foothold)
EVEN = Readings(0.0, 0.0, 0.0, (4000.0,) * 6)


def test_planned_step_is_stable() -> None:
    for margins in (
        margins_of_leg_move(STEP.before, LEG_MOVE),
        margins_of_body_move(LANDED, plan_body_move(STEP, LEG_MOVE.foothold)),
    ):
        assert is_stable(margins)
        assert margins.support > LEAST_SUPPORT
        assert margins.energy > LEAST_ENERGY


def test_body_move_too_far_is_unstable() -> None:
    margins = margins_of_body_move(a_stance(), BodyMove(Pose(1.3, 0.0, 0.0, 2.7), 2.0))
    assert not is_stable(margins)
    assert margins.support < LEAST_SUPPORT


def test_only_a_move_away_from_the_support_edge_is_stable() -> None:
    near_the_edge = a_stance()
    near_the_edge = replace(near_the_edge, pose=replace(near_the_edge.pose, x=1.3))
    assert is_stable(margins_of_body_move(near_the_edge, BodyMove(Pose(0.0, 0.0, 0.0, 2.7), 2.0)))
    assert not is_stable(
        margins_of_body_move(near_the_edge, BodyMove(Pose(1.4, 0.0, 0.0, 2.7), 2.0))
    )
    assert not is_stable(
        margins_of_body_move(near_the_edge, BodyMove(Pose(1.2, 0.0, 0.0, 2.7), 2.0))
    )


def test_lifting_a_supporting_leg_is_unstable() -> None:
    stance = with_foot(with_foot(a_stance(), Foot(0, -0.6, 2.3, 0.0)), Foot(1, -1.0, 2.3, 0.0))
    margins = margins_of_leg_move(replace(stance, pose=replace(stance.pose, x=0.5)), LEG_MOVE)
    assert not is_stable(margins)


@pytest.mark.parametrize(
    "worse", [Margins(0.2, 0.3, 0.1), Margins(0.6, -0.3, 0.1), Margins(0.6, 0.3, 0.01)]
)
def test_low_margin_of_any_kind_is_unstable(worse: Margins) -> None:
    assert not is_stable(worse)
    assert is_stable(Margins(0.6, 0.3, 0.1))


@pytest.mark.parametrize(
    ("shift", "load", "fault"),
    [
        ((0.0, 0.0, 0.0), -200.0, "leg 2 bears only -0.2 kN"),
        ((0.3, 0.4, 0.0), 4000.0, "leg 2 stands 0.50 m beside its foothold"),
        ((0.0, 0.0, 0.4), 4000.0, "leg 2 stands 0.40 m above its foothold"),
        ((0.0, 0.0, -0.4), 4000.0, "leg 2 stands 0.40 m below its foothold"),
    ],
)
def test_footfall_fault_is_described(
    shift: tuple[float, float, float], load: float, fault: str
) -> None:
    planned = LEG_MOVE.foothold
    foot = Foot(planned.leg, planned.x + shift[0], planned.y + shift[1], planned.z + shift[2])
    loads = tuple(load if leg == planned.leg else 4000.0 for leg in range(6))
    assert fault_of_footfall(LEG_MOVE, with_foot(LANDED, foot), replace(EVEN, loads=loads)) == fault
