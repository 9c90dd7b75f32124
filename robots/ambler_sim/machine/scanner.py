"""The laser range scanner on the mast: the directions of its rays and the noise of its ranges."""

from collections.abc import Callable

import numpy as np

from robots.ambler_sim.geometry import Array
from robots.ambler_sim.machine.plant import rotation_matrix
from robots.ambler_sim.vocabulary import Attitude

MOUNT = np.array([0.9, 0.0, 2.6])
"""The scanner's place in the body frame: in front of the bridge, above the equipment boxes."""

ROWS, COLUMNS = 64, 96
RANGE = 14.0
NOISE = 0.02
SWEEP = 0.5
"""Seconds from the nearest row to the farthest."""

_NEAREST, _FARTHEST = np.radians(-78.0), np.radians(-24.0)
_SIDEWAYS = np.radians(85.0)


def scan(
    cast: Callable[[Array, Array, float], Array],
    attitude: Attitude,
    seed: tuple[int, int],
    velocity: Array,
) -> Array:
    """Return the world points (n, 3) where the rays meet the ground; the same *seed* gives the same
    noise.

    All rays leave at once. While the body moves (*velocity*, m/s) the image is blurred as if the
    sweep took SWEEP seconds, row by row.
    """
    turn = rotation_matrix(attitude)
    position = np.array([attitude.pose.x, attitude.pose.y, attitude.pose.height])
    origin = position + turn @ MOUNT
    directions = ray_directions() @ turn.T
    distances = cast(origin, directions, RANGE)
    distances = distances + np.random.default_rng(seed).normal(0.0, NOISE, len(distances))
    hit = np.isfinite(distances)
    seconds_into_sweep = np.repeat(np.linspace(0.0, SWEEP, ROWS), COLUMNS)[hit, None]
    points: Array = origin + distances[hit, None] * directions[hit] - seconds_into_sweep * velocity
    return points


def ray_directions() -> Array:
    """Return unit vectors in the body frame, row by row from near to far."""
    down, sideways = np.meshgrid(
        np.linspace(_NEAREST, _FARTHEST, ROWS),
        np.linspace(-_SIDEWAYS, _SIDEWAYS, COLUMNS),
        indexing="ij",
    )
    rays = np.stack(
        [np.cos(down) * np.cos(sideways), np.cos(down) * np.sin(sideways), np.sin(down)], axis=-1
    )
    return rays.reshape(-1, 3)
