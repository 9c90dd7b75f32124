"""Checks before and after a move: from a stance, a planned move and sensors to a verdict."""

from dataclasses import astuple, dataclass, replace

from robots.ambler_sim.geometry import distance
from robots.ambler_sim.planning.gait import with_foot
from robots.ambler_sim.planning.stability import conservative_margin, energy_margin, support_margin
from robots.ambler_sim.vocabulary import BodyMove, LegMove, Readings, Stance

LEAST_SUPPORT = 0.35
"""Metres. With less, two springy feet bear nearly all, and the body tilts by more than a degree."""

LEAST_CONSERVATIVE = -0.2
"""Metres: below 0 the failure of one more leg could tip the robot. On slopes of 30 % the gait
itself comes to -0.15.
"""

LEAST_ENERGY = 0.018
"""Metres: a little less than LEAST_SUPPORT means on level ground; downhill the robot tips more
easily.
"""

LEAST_LOAD = 500.0
"""Newtons that a foot bears which stands."""

FARTHEST_ASIDE = 0.25
FARTHEST_OFF_LEVEL = 0.35


@dataclass(frozen=True, slots=True)
class Margins:
    """How far the robot stays from tipping over: its centre of gravity from the nearest support
    edge (m), the same when the worst further leg fails, and how far it would have to rise to tip
    (m).
    """

    support: float
    conservative: float
    energy: float

    def __str__(self) -> str:
        return f"{self.support:.2f} m to the edge, {self.conservative:.2f} m without one more leg, {self.energy:.3f} m up"


def margins_of_leg_move(stance: Stance, move: LegMove) -> Margins:
    """The least while the leg is in the air: at either end of its way, for a leg weighs a tenth of
    the robot. That without one more leg is for when it stands on its foothold.
    """
    after = with_foot(stance, move.foothold)
    both = stance, after
    return Margins(
        min(support_margin(each, move.leg) for each in both),
        conservative_margin(after),
        min(energy_margin(each, move.leg) for each in both),
    )


def margins_of_body_move(stance: Stance, move: BodyMove) -> Margins:
    """The least at either end of the move: between them the body is nowhere nearer to an edge, feet
    are convex. Of a move that leads to where the robot stands better, those of its end: it stands
    already where the move begins.
    """
    before, after = _margins(stance), _margins(replace(stance, pose=move.goal))
    least = Margins(*map(min, astuple(before), astuple(after)))
    return after if least == before else least


def _margins(stance: Stance) -> Margins:
    return Margins(support_margin(stance), conservative_margin(stance), energy_margin(stance))


def is_stable(margins: Margins) -> bool:
    """Whether a move with these margins may be made."""
    return (
        margins.support >= LEAST_SUPPORT
        and margins.conservative >= LEAST_CONSERVATIVE
        and margins.energy >= LEAST_ENERGY
    )


def fault_of_footfall(move: LegMove, stance: Stance, readings: Readings) -> str:
    """The fault in how the foot stands after a leg move; "" if there is none."""
    foot, load = stance.feet[move.leg], readings.loads[move.leg]
    aside = distance(foot, move.foothold)
    off_level = foot.z - move.foothold.z
    if not load >= LEAST_LOAD:  # broken sensors say NaN
        return f"leg {move.leg} bears {load / 1000:.1f} kN only"
    if aside > FARTHEST_ASIDE:
        return f"leg {move.leg} stands {aside:.2f} m beside its foothold"
    if abs(off_level) > FARTHEST_OFF_LEVEL:
        return f"leg {move.leg} stands {abs(off_level):.2f} m {'above' if off_level > 0 else 'below'} its foothold"
    return ""
