"""The choice of a foothold: the best cell near the ideal one.

The cost of a cell is the sum of several costs. They are the slope, roughness and curvature of the
patch around the cell, and the distance from the ideal foothold. A cell that was not measured also
costs a penalty.
"""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from robots.ambler_sim.errors import NoFootfall
from robots.ambler_sim.geometry import (
    Array,
    circulating_angle,
    circulation,
    joints_of,
    positions,
    side_of,
    to_body,
    within_limits,
)
from robots.ambler_sim.planning.elevation import Mask, heights_of, known_cells
from robots.ambler_sim.vocabulary import ElevationMap, Foot, Step, Window

SEARCH_RADIUS = 0.5
"""How far (m) from the ideal foothold cells are candidates."""

PATCH = 5
"""Cells on each side of the patch around a candidate."""

STEEPEST = 0.6
ROUGHEST = 0.08
"""The greatest slope (rise per run) and roughness (m) of a patch to stand on."""

LEG_SPACING = 0.35
ANGLE_SPACING = 0.12
"""The least distance (m) between two feet, and the least angle (rad) between legs of a stack."""

RESERVE = 0.05
"""Reach and drop (m) to spare, because feet and bodies stop a little beside their goals."""

SLOPE_COST = 1.0
ROUGHNESS_COST = 15.0
CURVATURE_COST = 0.1
DISTANCE_COST = 0.3
UNKNOWN_COST = 0.2


def window_of(step: Step) -> Window:
    """Return the ground needed to choose a step's foothold."""
    return Window(step.ideal.x, step.ideal.y, SEARCH_RADIUS + PATCH * 0.1)


@dataclass(frozen=True, slots=True)
class Candidates:
    """Cells near the ideal foothold, a row each: place (x, y, z) and shape of the ground there."""

    places: Array
    slope: Array
    roughness: Array
    curvature: Array
    known: Mask


def choose_foothold(ground: ElevationMap, step: Step, radius: float = SEARCH_RADIUS) -> Foot:
    """Choose the cheapest cell that is fit to stand on and stays within reach until the foot is
    lifted again.

    Raises NoFootfall with the number of cells that failed for each reason.
    """
    cells = candidates(ground, step.ideal, radius)
    sound = _is_sound(cells)
    reachable = _is_reachable(cells.places, step)
    free = _is_free(cells.places, step)
    usable = sound & reachable & free
    if not usable.any():
        raise NoFootfall(_reasons(step, sound, reachable, free))
    best = int(np.argmin(np.where(usable, costs(cells, step.ideal), np.inf)))
    x, y, z = cells.places[best]
    return Foot(step.leg, float(x), float(y), float(z))


def costs(cells: Candidates, ideal: Foot) -> Array:
    """Return the cost of each cell. A metre from the ideal costs as much as 30 % slope."""
    distance = np.hypot(cells.places[:, 0] - ideal.x, cells.places[:, 1] - ideal.y)
    ground: Array = (
        SLOPE_COST * cells.slope
        + ROUGHNESS_COST * cells.roughness
        + CURVATURE_COST * cells.curvature
    )
    return ground + DISTANCE_COST * distance + UNKNOWN_COST * ~cells.known


def candidates(ground: ElevationMap, ideal: Foot, radius: float = SEARCH_RADIUS) -> Candidates:
    """Every cell within *radius* of the ideal foothold whose patch is known or filled in."""
    margin = PATCH // 2
    known = known_cells(ground)[margin:-margin, margin:-margin]
    patches = sliding_window_view(heights_of(ground), (PATCH, PATCH)).reshape(-1, PATCH * PATCH)
    row, column = np.indices(known.shape).reshape(2, -1)
    x = ground.x + ground.resolution * (margin + row)
    y = ground.y + ground.resolution * (margin + column)
    near = (np.hypot(x - ideal.x, y - ideal.y) <= radius) & np.isfinite(patches).all(axis=1)
    return _fitted(patches[near], x[near], y[near], known.ravel()[near], ground.resolution)


def _fitted(patches: Array, x: Array, y: Array, known: Mask, resolution: float) -> Candidates:
    """Fit a quadric to each patch by least squares: its tilt, its curvature and its residual.

    One fit serves all patches, because all have the same x and y.
    """
    u, v = resolution * (np.indices((PATCH, PATCH)).reshape(2, -1) - PATCH // 2)
    shape = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=1)
    fit = np.linalg.pinv(shape) @ patches.T
    residual = patches - (shape @ fit).T
    return Candidates(
        places=np.stack([x, y, fit[0]], axis=1),
        slope=np.hypot(fit[1], fit[2]),
        roughness=residual.std(axis=1),
        curvature=np.abs(2 * fit[3] + 2 * fit[5]),
        known=known,
    )


def _is_sound(cells: Candidates) -> Mask:
    sound: Mask = (cells.slope <= STEEPEST) & (cells.roughness <= ROUGHEST)
    return sound


def _is_reachable(places: Array, step: Step) -> Mask:
    """Mask the cells that are in reach all the time until the foot is lifted again."""
    legs = [step.leg] * len(places)
    reachable = np.ones(len(places), dtype=bool)
    for pose in step.support:
        reachable &= within_limits(joints_of(to_body(pose, places), legs=legs), RESERVE)
    return reachable


def _is_free(places: Array, step: Step) -> Mask:
    """Mask the cells away from other feet and in front of the stack's other legs (in order)."""
    others = [foot for foot in step.before.feet if foot.leg != step.leg]
    x, y, _ = positions(step.before)[[foot.leg for foot in others]].T
    gaps = np.hypot(places[:, [0]] - x, places[:, [1]] - y)
    pose = step.before.pose
    foremost = min(
        circulating_angle(pose, foot) for foot in others if foot.leg in side_of(step.leg)
    )
    angles = joints_of(to_body(pose, places), legs=[step.leg] * len(places))[:, 0]
    in_front = circulation(step.leg) * angles <= foremost - ANGLE_SPACING
    free: Mask = (gaps.min(axis=1) >= LEG_SPACING) & in_front
    return free


def _reasons(step: Step, sound: Mask, reachable: Mask, free: Mask) -> str:
    where = f"near x {step.ideal.x:.2f}, y {step.ideal.y:.2f}"
    counts = (
        f"{(~sound).sum()} unsound, {(~reachable).sum()} out of reach,"
        f" {(~free).sum()} in the way of other legs"
    )
    return f"no foothold for leg {step.leg} {where}: of {len(sound)} cells {counts}"
