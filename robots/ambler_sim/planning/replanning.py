"""Alternatives for a leg that could not go where it was sent. Pure: no messages."""

import contextlib
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from robots.ambler_sim.errors import (
    AmblerError,
    NoFootfall,
    NoStep,
    OutOfReach,
    PathBlocked,
    UnstableMove,
)
from robots.ambler_sim.geometry import circulating_angle, circulation, distance, offset, side_of
from robots.ambler_sim.planning.checks import is_stable, margins_of_body_move, margins_of_leg_move
from robots.ambler_sim.planning.elevation import AHEAD, SIZE, height_at
from robots.ambler_sim.planning.footfall import choose_foothold
from robots.ambler_sim.planning.gait import (
    mean_height,
    next_leg,
    next_step,
    plan_body_move,
    plan_shift,
    standard_places,
    with_foot,
)
from robots.ambler_sim.planning.leg_recovery import plan_swing, require_lift
from robots.ambler_sim.planning.stability import conservative_margin, energy_margin
from robots.ambler_sim.vocabulary import (
    LEGS,
    NO_LEG,
    Arc,
    BodyMove,
    Contact,
    ElevationMap,
    Foot,
    LegMove,
    Obstacle,
    Stance,
    Step,
    Window,
)

RAISE = 0.4
"""How far (m) above an obstacle the foot is lifted in the second try."""

OBSTACLE_RADIUS = 0.45
"""The assumed radius (m) of a felt obstacle: it was felt at one point only, and feet are broad."""

FOOT_ROOM = 0.2
"""The radius (m) around a place where no foot should stand."""

CLEAR_OF_FOOT = 0.05
"""The distance (m) from a foot to the obstacle that it met. The foot may move on from there."""

RADII = (None, 1.0, 1.3, 1.45, 1.6, 1.75, 1.9, 2.05)
"""The radii (m) around its shaft at which a leg may swing clear of other legs.

None is the usual way, and is tried first.
"""

IN_PLACE = 0.15
"""A foot at most this far (m) from its place is not moved."""

WIDER = 1.0
"""The radius (m) of the second search, if there is no foothold near the ideal one."""

BESIDE = ((0.0, 0.0), (0.35, 0.0), (-0.35, 0.0), (0.0, 0.35), (0.0, -0.35))
"""Offsets (m) from a place of the standard configuration."""

SHIFTS = (0.0, 0.2, -0.2, 0.4, -0.4, 0.6, -0.6)
"""Shifts (m) of the body ahead or to the left, for a better stance."""

STANDS_WELL = 0.2
"""With this conservative margin (m) or more the body is not shifted."""

ADVANCES = (0.5, 0.25, 0.12)
"""How far (m) the body moves with a footstep."""


def window_around(stance: Stance) -> Window:
    """Return the ground needed to move any leg."""
    return Window(*offset(stance.pose, AHEAD, 0.0), SIZE / 2)


def obstacle_at(contact: Contact) -> Obstacle:
    """Return the obstacle at *contact*: beyond the foot, or under it."""
    if not (contact.dx or contact.dy):
        return Obstacle(contact.x, contact.y, contact.z, FOOT_ROOM, is_wall=False)
    reach = OBSTACLE_RADIUS + CLEAR_OF_FOOT
    x, y = contact.x + reach * contact.dx, contact.y + reach * contact.dy
    return Obstacle(x, y, contact.z, OBSTACLE_RADIUS, is_wall=True)


def raised_move(move: LegMove, stance: Stance, contact: Contact) -> LegMove:
    """Return the move, RAISE above the obstacle. Raises PathBlocked if the leg is too short for
    that.
    """
    lift = max(move.lift, contact.z) + RAISE
    require_lift(stance.pose, move.leg, lift)
    return replace(move, lift=lift)


def another_way(ground: ElevationMap, step: Step) -> LegMove:
    """Plan the leg's part of a step around obstacles, from the foot's present place.

    Raises NoFootfall or PathBlocked if there is no way.
    """
    try:
        foothold = choose_foothold(ground, step)
    except NoFootfall:
        foothold = choose_foothold(ground, step, WIDER)
    angle = circulating_angle(step.before.pose, step.before.feet[step.leg])
    return _plan_way(
        ground, step.before, foothold, circulation(step.leg) if angle > math.pi / 2 else 0
    )


@dataclass(frozen=True, slots=True)
class Alternative:
    """A whole footstep: its plan, the leg's move and the body's."""

    step: Step
    leg_move: LegMove
    body_move: BodyMove


def another_step(
    ground: ElevationMap, stance: Stance, arc: Arc, preferred: int = NO_LEG
) -> Alternative:
    """Return the first footstep that is possible from *stance*.

    The first try is with the leg whose turn it is, or *preferred*. Then come the other legs from
    the rear. Then all legs are tried again with shorter moves of the body. Raises NoStep with the
    reason against the first try.
    """
    first = preferred if preferred in LEGS else next_leg(stance)
    others = sorted(
        set(LEGS) - {first}, key=lambda leg: -circulating_angle(stance.pose, stance.feet[leg])
    )
    first_problem = ""
    for advance in ADVANCES:
        for leg in (first, *others):
            try:
                return _alternative(ground, next_step(stance, arc, leg, advance))
            except AmblerError as error:
                first_problem = first_problem or str(error)
    raise NoStep(first_problem)


def _alternative(ground: ElevationMap, step: Step) -> Alternative:
    leg_move = another_way(ground, step)
    body_move = plan_body_move(step, leg_move.foothold)
    after = with_foot(step.before, leg_move.foothold)
    for margins in (
        margins_of_leg_move(step.before, leg_move),
        margins_of_body_move(after, body_move),
    ):
        if not is_stable(margins):
            raise UnstableMove(f"the step with leg {step.leg} would leave only {margins}")
    return Alternative(step, leg_move, body_move)


def centring_move(stance: Stance) -> BodyMove | None:
    """Return a move of the body to where any leg can be lifted, as far as the feet allow.

    None if the body stands well, or if no better place nearby can be reached safely.
    """
    best, most = None, conservative_margin(stance)
    if most >= STANDS_WELL:
        return None
    for ahead in SHIFTS:
        for left in SHIFTS:
            x, y = offset(stance.pose, ahead, left)
            with contextlib.suppress(AmblerError):
                move = plan_shift(stance, replace(stance.pose, x=x, y=y))
                margin = conservative_margin(replace(stance, pose=move.goal))
                if margin > most and is_stable(margins_of_body_move(stance, move)):
                    best, most = move, margin
    return best


def shuffle(ground: ElevationMap, stance: Stance, blocked: int) -> list[LegMove]:
    """Plan moves of the feet into the standard configuration in which the side without the blocked
    leg steps first.

    After that step the body is further on, and the blocked leg swings elsewhere. The robot is
    stable during each move. The blocked leg's side moves last, the blocked leg itself at the very
    end if possible. Within these groups, the legs that would be hardest to lift from the final
    stance move first. Feet that can't be moved safely stay.
    """
    places = standard_places(stance, first=(blocked + len(LEGS) // 2) % len(LEGS))
    in_the_end = replace(stance, feet=places)
    moves: list[LegMove] = []
    unmoved: set[int] = set(LEGS)
    while safe := list(
        _safe_moves(ground, stance, [place for place in places if place.leg in unmoved])
    ):
        chosen = min(
            safe,
            key=lambda move: (
                move.leg in side_of(blocked),
                move.leg == blocked,
                energy_margin(in_the_end, move.leg),
            ),
        )
        moves.append(chosen)
        unmoved.remove(chosen.leg)
        stance = with_foot(stance, chosen.foothold)
    return moves


def _safe_moves(ground: ElevationMap, stance: Stance, places: Iterable[Foot]) -> Iterator[LegMove]:
    """Yield the possible moves to these places, for feet that are not yet there."""
    for place in places:
        if distance(stance.feet[place.leg], place) > IN_PLACE:
            with contextlib.suppress(OutOfReach, PathBlocked):
                move = _move_to(ground, stance, place)
                if is_stable(margins_of_leg_move(stance, move)):
                    yield move


def _move_to(ground: ElevationMap, stance: Stance, place: Foot) -> LegMove:
    """Plan a move straight to a place of the standard configuration. A leg within the body moves
    backwards, as it came.
    """
    foothold = _known_place(ground, stance, place)
    is_inside = circulating_angle(stance.pose, stance.feet[place.leg]) > math.pi
    return _plan_way(ground, stance, foothold, -circulation(place.leg) if is_inside else 0)


def _known_place(ground: ElevationMap, stance: Stance, place: Foot) -> Foot:
    """Return the place with its height in the map, or a place beside it with a known height.

    If no height is known, the place gets the mean height of the feet.
    """
    for ahead, left in BESIDE:
        x, y = place.x + ahead, place.y + left
        if math.isfinite(height := height_at(ground, x, y)):
            return replace(place, x=x, y=y, z=height)
    return replace(place, z=mean_height(stance.feet))


def _plan_way(ground: ElevationMap, stance: Stance, foothold: Foot, sense: int) -> LegMove:
    """Plan a move to a foothold at the first free one of RADII. Raises PathBlocked if no radius is
    free.
    """
    for radius in RADII:
        with contextlib.suppress(PathBlocked):
            return plan_swing(ground, stance, foothold, sense, radius)
    raise PathBlocked(f"leg {foothold.leg} finds no way to x {foothold.x:.2f}, y {foothold.y:.2f}")
