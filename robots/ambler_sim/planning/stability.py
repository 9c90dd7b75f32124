"""The distance of the robot from tipping over, from its stance alone."""

import math

import numpy as np

from robots.ambler_sim.geometry import AMBLER, GRAVITY, Array, feet_of, stance_joints, to_world
from robots.ambler_sim.vocabulary import LEGS, Stance

WEIGHT = AMBLER.mass * GRAVITY

LEAST_CORNERS = 3

Corner = tuple[float, float, float]


def centre_of_gravity(joints: Array) -> Array:
    """Return the robot's centre of gravity in the body frame for (angle, reach, drop) of the six
    legs.
    """
    parts = AMBLER
    feet = feet_of(joints)
    levels = feet[:, 2] + joints[:, 2]
    outward = np.stack([np.cos(joints[:, 0]), np.sin(joints[:, 0])], axis=1)
    # How much nearer the two beams' centres are to the shaft than the foot is, times their mass.
    inner = (
        parts.shoulder_mass * (joints[:, 1] - parts.min_reach / 2)
        + parts.extension_mass * parts.beam_length / 2
    )
    moment = np.array([0.0, 0.0, parts.body_mass * parts.body_mass_height])
    moment[:2] += (parts.leg_mass * feet[:, :2] - inner[:, None] * outward).sum(axis=0)
    low = parts.vertical_mass * parts.link_length / 2 + parts.foot_mass * parts.foot_radius
    beams = (parts.shoulder_mass + parts.extension_mass) * levels
    links = (parts.vertical_mass + parts.foot_mass) * feet[:, 2] + low
    moment[2] += (beams + links).sum()
    centre: Array = moment / parts.mass
    return centre


def world_centre_of_gravity(stance: Stance) -> Array:
    """Return the centre of gravity of a robot in *stance* in the world, (3,)."""
    centre: Array = to_world(stance.pose, centre_of_gravity(stance_joints(stance))[None, :])[0]
    return centre


def support_polygon(stance: Stance, *lifted: int) -> Array:
    """Return the outermost of the feet that bear load, counter-clockwise seen from above, (n,
    3).
    """
    points = sorted((foot.x, foot.y, foot.z) for foot in stance.feet if foot.leg not in lifted)
    return np.array(_half_hull(points) + _half_hull(points[::-1]))


def support_margin(stance: Stance, *lifted: int) -> float:
    """Return the horizontal distance (m) of the centre of gravity from the nearest support edge.

    Negative when the centre is outside, -inf when fewer than three feet stand.
    """
    corners = support_polygon(stance, *lifted)
    if len(corners) < LEAST_CORNERS:
        return -math.inf
    edges, to_centre = _edges_and_arms(corners, stance)
    return float((_inward(edges, to_centre) / np.hypot(edges[:, 0], edges[:, 1])).min())


def conservative_margin(stance: Stance, *lifted: int) -> float:
    """Return the support margin without the worst further leg (conservative support polygon,
    1989).
    """
    return min(support_margin(stance, *lifted, leg) for leg in LEGS if leg not in lifted)


def energy_margin(stance: Stance, *lifted: int) -> float:
    """Return how far (m) the centre of gravity has to rise to tip over the weakest edge (Messuri
    and Klein, 1985).

    This is the energy stability margin divided by the weight. It is negative when the robot already
    tips.
    """
    edges, to_centre = _edges_and_arms(support_polygon(stance, *lifted), stance)
    along = edges / np.linalg.norm(edges, axis=1)[:, None]
    arms = to_centre - (to_centre * along).sum(axis=1)[:, None] * along
    up = np.array([0.0, 0.0, 1.0]) - along[:, 2:] * along
    rises = np.linalg.norm(arms, axis=1) * np.linalg.norm(up, axis=1) - (arms * up).sum(axis=1)
    return float(np.where(_inward(edges, to_centre) >= 0, rises, -rises).min())


def least_norm_loads(feet: Array, loads: Array) -> Array:
    """Return the most even vertical forces on *feet* with the same sum and moments as *loads*."""
    arms = np.stack([np.ones(len(feet)), feet[:, 1], -feet[:, 0]])
    even: Array = arms.T @ np.linalg.solve(arms @ arms.T, arms @ loads)
    return even


def _edges_and_arms(corners: Array, stance: Stance) -> tuple[Array, Array]:
    """Return each edge of the polygon, and the vector from its first corner to the centre of
    gravity.
    """
    return np.roll(corners, -1, axis=0) - corners, world_centre_of_gravity(stance) - corners


def _inward(edges: Array, arms: Array) -> Array:
    """Return twice the area between edge and arm seen from above, positive where the arm points
    inward.
    """
    area: Array = edges[:, 0] * arms[:, 1] - edges[:, 1] * arms[:, 0]
    return area


def _half_hull(points: list[Corner]) -> list[Corner]:
    """Return one side of the convex hull of sorted points, without the last point (Andrew's
    monotone chain).
    """
    hull: list[Corner] = []
    for point in points:
        while len(hull) >= 2 and not _turns_left(hull[-2], hull[-1], point):
            hull.pop()
        hull.append(point)
    return hull[:-1]


def _turns_left(a: Corner, b: Corner, c: Corner) -> bool:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > 0
