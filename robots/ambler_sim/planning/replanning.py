"""Other ways to go on, for when a leg could not go where it was sent. Pure; nothing here knows of messages."""

import contextlib
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from robots.ambler_sim.errors import OutOfReach, PathBlocked
from robots.ambler_sim.geometry import AMBLER, SHOULDER_Z, circulating_angle, circulation, side_of
from robots.ambler_sim.planning.checks import is_stable, margins_of_leg_move
from robots.ambler_sim.planning.elevation import height_at, with_patch
from robots.ambler_sim.planning.footfall import choose_foothold
from robots.ambler_sim.planning.gait import mean_height, standard_places, with_foot
from robots.ambler_sim.planning.leg_recovery import plan_swing
from robots.ambler_sim.planning.stability import energy_margin
from robots.ambler_sim.vocabulary import LEGS, Contact, ElevationMap, Foot, LegMove, Stance, Step

RAISE = 0.4
OBSTACLE_RADIUS = 0.45
"""Of what a leg met (m): it was felt at one point only, and feet are broad."""

FOOT_ROOM = 0.2
"""Around a place (m) where no foot should stand."""

STANDING_ON = 0.1
RADII = (None, 1.0, 1.3, 1.45, 1.6, 1.75, 1.9, 2.05)
"""How far from its shaft (m) a leg may swing, the usual way first. Further out it would come near other legs."""

IN_PLACE = 0.15


@dataclass(frozen=True, slots=True)
class Avoided:
    """A place that legs should not pass (*is_wall*), or not stand on."""

    x: float
    y: float
    is_wall: bool


def felt(contact: Contact, foot: Foot) -> Avoided:
    """The obstacle at *contact*, from where the *foot* was then put down: before it, or on it."""
    x, y = contact.x - foot.x, contact.y - foot.y
    distance = math.hypot(x, y)
    if distance < STANDING_ON:
        return Avoided(contact.x, contact.y, is_wall=False)
    reach = (OBSTACLE_RADIUS - STANDING_ON) / distance
    return Avoided(contact.x + reach * x, contact.y + reach * y, is_wall=True)


def without(ground: ElevationMap, avoided: Iterable[Avoided]) -> ElevationMap:
    """The map with all that is known to be there, or to be avoided, in it."""
    for place in avoided:
        radius, height = (OBSTACLE_RADIUS, math.inf) if place.is_wall else (FOOT_ROOM, math.nan)
        ground = with_patch(ground, place.x, place.y, radius, height)
    return ground


def raised(move: LegMove, stance: Stance, contact: Contact) -> LegMove:
    """The move RAISE above the obstacle. Raises PathBlocked when the leg is too short for that."""
    lift = max(move.lift, contact.z) + RAISE
    ceiling = stance.pose.height + float(SHOULDER_Z[move.leg]) - AMBLER.min_drop
    if lift > ceiling:
        raise PathBlocked(f"leg {move.leg} can be lifted to {ceiling:.2f} m, not to {lift:.2f} m")
    return replace(move, lift=lift)


def another_way(ground: ElevationMap, step: Step) -> LegMove:
    """The leg's part of a step from wherever its foot now is, around what stands in its way.

    Raises NoFootfall or PathBlocked when there is no way.
    """
    foothold = choose_foothold(ground, step)
    angle = circulating_angle(step.before.pose, step.before.feet[step.leg])
    return _way(ground, step.before, foothold, circulation(step.leg) if angle > math.pi / 2 else 0)


def shuffle(ground: ElevationMap, stance: Stance, blocked: int) -> list[LegMove]:
    """Moves that bring the feet into the standard configuration around the body in which the side that is not *blocked*
    steps first: when it has, the body is further on, and the blocked leg swings elsewhere.

    At each move the robot is stable. The blocked leg's side goes last, and of that the leg itself, if that can be; of
    the others those first that would be the hardest to lift in the end. Feet that can't be brought to their places
    safely stay.
    """
    places = standard_places(stance, first=(blocked + len(LEGS) // 2) % len(LEGS))
    in_the_end = replace(stance, feet=places)
    moves: list[LegMove] = []
    waiting = set(LEGS)
    while safe := list(_safe_moves(ground, stance, [place for place in places if place.leg in waiting])):
        chosen = min(
            safe,
            key=lambda move: (move.leg in side_of(blocked), move.leg == blocked, energy_margin(in_the_end, move.leg)),
        )
        moves.append(chosen)
        waiting.remove(chosen.leg)
        stance = with_foot(stance, chosen.foothold)
    return moves


def _safe_moves(ground: ElevationMap, stance: Stance, places: Iterable[Foot]) -> Iterator[LegMove]:
    """For each of these places where its foot is not, the move there, if it can be made."""
    for place in places:
        if _distance(stance.feet[place.leg], place) > IN_PLACE:
            with contextlib.suppress(OutOfReach, PathBlocked):
                move = _move_to(ground, stance, place)
                if is_stable(margins_of_leg_move(stance, move)):
                    yield move


def _move_to(ground: ElevationMap, stance: Stance, place: Foot) -> LegMove:
    """Straight to a place of the standard configuration; from within the body backwards, as the leg came."""
    height = height_at(ground, place.x, place.y)
    foothold = replace(place, z=height if math.isfinite(height) else mean_height(stance.feet))
    is_inside = circulating_angle(stance.pose, stance.feet[place.leg]) > math.pi
    return _way(ground, stance, foothold, -circulation(place.leg) if is_inside else 0)


def _way(ground: ElevationMap, stance: Stance, foothold: Foot, sense: int) -> LegMove:
    """To a foothold at the first of RADII at which nothing stands in the way. Raises PathBlocked if there is none."""
    for radius in RADII:
        with contextlib.suppress(PathBlocked):
            return plan_swing(ground, stance, foothold, sense, radius)
    raise PathBlocked(f"leg {foothold.leg} finds no way to x {foothold.x:.2f}, y {foothold.y:.2f}")


def _distance(one: Foot, other: Foot) -> float:
    return math.hypot(one.x - other.x, one.y - other.y)
