"""Checks before and after a move: a verdict from a stance, a planned move and sensors."""

from dataclasses import astuple, dataclass, replace

from robots.ambler_sim.geometry import distance
from robots.ambler_sim.planning.gait import with_foot
from robots.ambler_sim.planning.stability import conservative_margin, energy_margin, support_margin
from robots.ambler_sim.vocabulary import BodyMove, LegMove, Readings, Stance

LEAST_SUPPORT = 0.35
"""The least support margin (m).

With a smaller margin, two springy feet bear nearly all the weight, and the body tilts by over a
degree.
"""

LEAST_CONSERVATIVE = -0.2
"""The least conservative margin (m). Below 0 the failure of one more leg could tip the robot.

On slopes of 30 % the gait itself reaches -0.15.
"""

LEAST_ENERGY = 0.018
"""The least energy margin (m), a little less than that of LEAST_SUPPORT on level ground.

Downhill, the same support margin leaves less energy.
"""

LEAST_LOAD = 500.0
"""The least load (N) on a foot that stands."""

FARTHEST_ASIDE = 0.25
FARTHEST_OFF_LEVEL = 0.35
"""How far (m) a foot may stand from its foothold, seen from above and in height."""


@dataclass(frozen=True, slots=True)
class Margins:
    """How far the robot stays from tipping over.

    *support* (m) is the distance of its centre of gravity from the nearest support edge.
    *conservative* (m) is that distance if one more leg fails, in the worst case. *energy* (m) is
    how far the centre would have to rise to tip.
    """

    support: float
    conservative: float
    energy: float

    def __str__(self) -> str:
        return (
            f"{self.support:.2f} m to the edge, {self.conservative:.2f} m without one more leg,"
            f" {self.energy:.3f} m up"
        )


def margins_of_leg_move(stance: Stance, move: LegMove) -> Margins:
    """Return the least margins while the leg is in the air.

    They occur at an end of the leg's way, because a leg weighs only a tenth of the robot. The
    conservative margin is taken after the move, when the leg stands on its foothold.
    """
    after = with_foot(stance, move.foothold)
    ends = stance, after
    return Margins(
        min(support_margin(end, move.leg) for end in ends),
        conservative_margin(after),
        min(energy_margin(end, move.leg) for end in ends),
    )


def margins_of_body_move(stance: Stance, move: BodyMove) -> Margins:
    """Return the least margins at the two ends of the move.

    Between the ends they are no smaller, because support polygons are convex. If the move leads to
    a better stance, only the margins at its end count. The robot already stands at its start.
    """
    before, after = _margins(stance), _margins(replace(stance, pose=move.goal))
    least = Margins(*map(min, astuple(before), astuple(after)))
    return after if least == before else least


def _margins(stance: Stance) -> Margins:
    return Margins(support_margin(stance), conservative_margin(stance), energy_margin(stance))


def is_stable(margins: Margins) -> bool:
    """Return whether a move with these margins may be made."""
    return (
        margins.support >= LEAST_SUPPORT
        and margins.conservative >= LEAST_CONSERVATIVE
        and margins.energy >= LEAST_ENERGY
    )


def fault_of_footfall(move: LegMove, stance: Stance, readings: Readings) -> str:
    """Describe the fault of the foot after a leg move; "" if it stands well."""
    foot, load = stance.feet[move.leg], readings.loads[move.leg]
    aside = distance(foot, move.foothold)
    off_level = foot.z - move.foothold.z
    if not load >= LEAST_LOAD:  # broken sensors say NaN
        return f"leg {move.leg} bears only {load / 1000:.1f} kN"
    if aside > FARTHEST_ASIDE:
        return f"leg {move.leg} stands {aside:.2f} m beside its foothold"
    if abs(off_level) > FARTHEST_OFF_LEVEL:
        side = "above" if off_level > 0 else "below"
        return f"leg {move.leg} stands {abs(off_level):.2f} m {side} its foothold"
    return ""
