"""Photographs from raw renderings: camera, sky, shadows, contour lines and footprints."""

import math
from collections.abc import Sequence

import numpy as np

from robots import rendering
from robots.ambler_sim.geometry import Array, offset
from robots.ambler_sim.machine.terrain import Terrain
from robots.ambler_sim.vocabulary import Foot, Pose

SUN = (3.0, -5.0, 9.0)
SUN_DISTANCE = 60.0
SHADOW_SIZE = 900
"""Pixels on each side of the rendering that gives the shadows of a full-size picture."""

SOIL = np.array([206.0, 164.0, 126.0])
AMBIENT, DIFFUSE = 0.45, 0.62
SKY_TOP, SKY_HORIZON = np.array([112.0, 154.0, 200.0]), np.array([232.0, 236.0, 238.0])
CONTOUR_EVERY = 0.1
FOOTPRINT, FOOTPRINT_RIM = 0.27, 0.03
SMOOTH = 0.3


def camera_for(pose: Pose) -> rendering.Camera:
    """Return a camera ahead, to the right and a little above: it shows six legs, both stacks and
    the tracks.
    """
    x, y = offset(pose, 10.8, -8.0)
    target_x, target_y = offset(pose, -0.8, 0.1)
    return rendering.Camera(
        (x, y, pose.height + 3.2), (target_x, target_y, pose.height - 0.3), 33.0, near=2.0, far=80.0
    )


def sun_over(pose: Pose) -> rendering.Camera:
    """Return a camera at the sun. Ground that it does not see lies in shadow."""
    return rendering.camera_in_the_sun(
        SUN, SUN_DISTANCE, (pose.x, pose.y, pose.height), angle=11.0, depth=15.0
    )


def develop(
    frame: rendering.Rendering,
    from_sun: rendering.Rendering,
    terrain: Terrain,
    trail: Sequence[Foot],
) -> rendering.Pixels:
    """Make the finished picture, (height, width, 3).

    The ground is painted here, because the renderer colours height fields badly.
    """
    image = frame.colours.astype(np.float64)
    places = rendering.ground_places(frame)
    light = (
        _sunlight(places, terrain)
        * _lines(places)
        * _footprints(places, trail)
        * rendering.shadow(places, from_sun)
    )
    far = _haze(frame)
    image[frame.ground] = SOIL * (light * (1 - far))[:, None] + SKY_HORIZON * far[:, None]
    sky = ~(frame.ground | frame.objects)
    rows = np.linspace(0, 1, image.shape[0])[:, None, None]
    sky_colours = SKY_TOP + (SKY_HORIZON - SKY_TOP) * np.sqrt(rows)
    image[sky] = np.broadcast_to(sky_colours, image.shape)[sky]
    return rendering.halve(image)


def _sunlight(places: Array, terrain: Terrain) -> Array:
    """Return the brightness of places of the ground, by its angle to the sun."""
    x, y = places[:, 0], places[:, 1]
    dx = (terrain.heights_at(x + SMOOTH, y) - terrain.heights_at(x - SMOOTH, y)) / (2 * SMOOTH)
    dy = (terrain.heights_at(x, y + SMOOTH) - terrain.heights_at(x, y - SMOOTH)) / (2 * SMOOTH)
    toward = (
        (SUN[2] - SUN[0] * dx - SUN[1] * dy) / np.sqrt(1 + dx * dx + dy * dy) / math.hypot(*SUN)
    )
    brightness: Array = AMBIENT + DIFFUSE * toward.clip(min=0.0)
    return brightness


def _lines(places: Array) -> Array:
    """Return the brightness of places: darker on contour lines and on the lines of a one-metre
    grid.
    """
    contour = rendering.near_multiple(places[:, 2], CONTOUR_EVERY, 0.006)
    grid = rendering.near_multiple(places[:, :2], 1.0, 0.012).any(axis=1)
    return np.where(contour, 0.93, 1.0) * np.where(grid, 0.90, 1.0)


def _footprints(places: Array, trail: Sequence[Foot]) -> Array:
    """Return the brightness of places: dark rings and a trodden middle where feet have stood."""
    brightness = np.ones(len(places))
    x, y = places[:, 0], places[:, 1]
    for foot in trail:
        near = np.flatnonzero(np.abs(x - foot.x) < 2 * FOOTPRINT)
        distance = np.hypot(x[near] - foot.x, y[near] - foot.y)
        brightness[near[distance < FOOTPRINT]] = 0.75
        brightness[near[np.abs(distance - FOOTPRINT) < FOOTPRINT_RIM]] = 0.5
    return brightness


def _haze(frame: rendering.Rendering) -> Array:
    """Return how much (0 to 1) ground pixels fade into the colour of the horizon."""
    near, far, depth = frame.camera.near, frame.camera.far, frame.depths[frame.ground]
    distance = near * far / (far - depth * (far - near))
    haze: Array = 1 - np.exp(-((distance - 12).clip(min=0.0)) / 40)
    return haze
