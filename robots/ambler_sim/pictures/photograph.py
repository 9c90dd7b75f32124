"""From a raw rendering to a picture worth showing: where the camera stands, sky, shadows, contour lines, footprints."""

import math
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robots.ambler_sim.geometry import Array, offset
from robots.ambler_sim.machine.terrain import Terrain
from robots.ambler_sim.vocabulary import Foot, Pose

Pixels = NDArray[np.uint8]
Mask = NDArray[np.bool_]

SIZE = (960, 600)
RENDERED = (2 * SIZE[0], 2 * SIZE[1])
"""Twice as large, then averaged: the renderer draws hard edges."""

SUN = (3.0, -5.0, 9.0)
SUN_DISTANCE = 60.0
SHADOW_SIZE = 900
"""Pixels on each side of the rendering that shadows are taken from, for a picture of full size."""

SHADOW = 0.58
SOIL = np.array([206.0, 164.0, 126.0])
AMBIENT, DIFFUSE = 0.45, 0.62
SKY_TOP, SKY_HORIZON = np.array([112.0, 154.0, 200.0]), np.array([232.0, 236.0, 238.0])
CONTOUR_EVERY = 0.1
FOOTPRINT, FOOTPRINT_RIM = 0.27, 0.03
SMOOTH = 0.3
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
EIGHT_BIT_RGB = (8, 2, 0, 0, 0)
NO_FILTER = 0


@dataclass(frozen=True, slots=True)
class Camera:
    """Where it is, what it looks at, its vertical angle of view in degrees, and what distances it sees."""

    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    angle: float
    near: float
    far: float


@dataclass(frozen=True, eq=False)
class Rendering:
    """A rendering: RGB colours, depths (0 near to 1 far), which pixels are ground or objects on it, the world-to-screen
    matrix and the camera.
    """

    colours: Pixels = field(repr=False)
    depths: Array = field(repr=False)
    ground: Mask = field(repr=False)
    objects: Mask = field(repr=False)
    looking: Array
    camera: Camera


def camera_for(pose: Pose) -> Camera:
    """Ahead of the robot, to its right, a little above: six legs, both stacks and the tracks behind are seen."""
    x, y = offset(pose, 10.8, -8.0)
    target_x, target_y = offset(pose, -0.8, 0.1)
    return Camera((x, y, pose.height + 3.2), (target_x, target_y, pose.height - 0.3), 33.0, near=2.0, far=80.0)


def sun_over(pose: Pose) -> Camera:
    """From the sun: what the robot hides from there lies in its shadow."""
    x, y, z = (SUN_DISTANCE * part / math.hypot(*SUN) for part in SUN)
    here = (pose.x, pose.y, pose.height)
    return Camera((pose.x + x, pose.y + y, pose.height + z), here, 11.0, near=SUN_DISTANCE - 15, far=SUN_DISTANCE + 15)


def develop(frame: Rendering, from_sun: Rendering, terrain: Terrain, trail: Sequence[Foot]) -> Pixels:
    """The finished picture, (height, width, 3). The renderer colours height fields badly, so ground is painted here."""
    image = frame.colours.astype(np.float64)
    places = ground_places(frame)
    light = _sunlight(places, terrain) * _lines(places) * _footprints(places, trail) * shadow(places, from_sun)
    far = _haze(frame)
    image[frame.ground] = SOIL * (light * (1 - far))[:, None] + SKY_HORIZON * far[:, None]
    sky = ~(frame.ground | frame.objects)
    rows = np.linspace(0, 1, image.shape[0])[:, None, None]
    image[sky] = np.broadcast_to(SKY_TOP + (SKY_HORIZON - SKY_TOP) * np.sqrt(rows), image.shape)[sky]
    return halved(image)


def ground_places(frame: Rendering) -> Array:
    """The world point (n, 3) seen in each ground pixel, from its depth."""
    row, column = np.nonzero(frame.ground)
    height, width = frame.ground.shape
    across, down = 2 * (column + 0.5) / width - 1, 1 - 2 * (row + 0.5) / height
    screen = np.stack([across, down, 2 * frame.depths[frame.ground] - 1, np.ones(len(row))])
    world = np.linalg.inv(frame.looking) @ screen
    places: Array = (world[:3] / world[3]).T
    return places


def _sunlight(places: Array, terrain: Terrain) -> Array:
    """Brightness of the ground by how squarely the sun meets it."""
    x, y = places[:, 0], places[:, 1]
    dx = (terrain.heights_at(x + SMOOTH, y) - terrain.heights_at(x - SMOOTH, y)) / (2 * SMOOTH)
    dy = (terrain.heights_at(x, y + SMOOTH) - terrain.heights_at(x, y - SMOOTH)) / (2 * SMOOTH)
    toward = (SUN[2] - SUN[0] * dx - SUN[1] * dy) / np.sqrt(1 + dx * dx + dy * dy) / math.hypot(*SUN)
    brightness: Array = AMBIENT + DIFFUSE * toward.clip(min=0.0)
    return brightness


def _lines(places: Array) -> Array:
    """Brightness: darker along contour lines and on the lines of a one-metre grid."""
    contour = near_multiple(places[:, 2], CONTOUR_EVERY, 0.006)
    grid = near_multiple(places[:, 0], 1.0, 0.012) | near_multiple(places[:, 1], 1.0, 0.012)
    return np.where(contour, 0.93, 1.0) * np.where(grid, 0.90, 1.0)


def near_multiple(values: Array, step: float, width: float) -> Mask:
    """Where a value is nearer than *width* to a multiple of *step*."""
    near: Mask = np.abs(values - step * np.round(values / step)) < width
    return near


def _footprints(places: Array, trail: Sequence[Foot]) -> Array:
    """Brightness: dark rings and a trodden middle where feet have stood."""
    brightness = np.ones(len(places))
    x, y = places[:, 0], places[:, 1]
    for foot in trail:
        near = np.flatnonzero(np.abs(x - foot.x) < 2 * FOOTPRINT)
        distance = np.hypot(x[near] - foot.x, y[near] - foot.y)
        brightness[near[distance < FOOTPRINT]] = 0.75
        brightness[near[np.abs(distance - FOOTPRINT) < FOOTPRINT_RIM]] = 0.5
    return brightness


def shadow(places: Array, from_sun: Rendering) -> Array:
    """Brightness: SHADOW where the sun sees an object instead of the ground, with soft edges."""
    height, width = from_sun.objects.shape
    x, y, _, w = from_sun.looking @ np.vstack([places.T, np.ones(len(places))])
    column, row = ((x / w + 1) / 2 * width).astype(np.intp), ((1 - y / w) / 2 * height).astype(np.intp)
    lit = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    hidden = _softened(from_sun.objects.astype(np.float64))[row.clip(0, height - 1), column.clip(0, width - 1)]
    return np.where(lit, 1 - (1 - SHADOW) * hidden, 1.0)


def _softened(cells: Array) -> Array:
    """Mean over 5 by 5 cells."""
    for axis in (0, 1):
        cells = np.mean([np.roll(cells, shift, axis) for shift in (-2, -1, 0, 1, 2)], axis=0)
    return cells


def _haze(frame: Rendering) -> Array:
    """How much (0 to 1) ground pixels fade into the colour of the horizon."""
    near, far, depth = frame.camera.near, frame.camera.far, frame.depths[frame.ground]
    distance = near * far / (far - depth * (far - near))
    haze: Array = 1 - np.exp(-((distance - 12).clip(min=0.0)) / 40)
    return haze


def halved(image: Array) -> Pixels:
    """Half the size, each pixel the mean of four."""
    height, width, colours = image.shape
    blocks = image.reshape(height // 2, 2, width // 2, 2, colours)
    halved: Pixels = blocks.mean(axis=(1, 3)).round().clip(0, 255).astype(np.uint8)
    return halved


def write_png(path: Path, pixels: Pixels) -> None:
    """Write (height, width, 3) pixels as PNG, with the standard library alone."""
    height, width, _ = pixels.shape
    header = struct.pack(">2I5B", width, height, *EIGHT_BIT_RGB)
    filters = np.full((height, 1), NO_FILTER, dtype=np.uint8)
    rows = np.hstack([filters, pixels.reshape(height, width * 3)])
    body = zlib.compress(rows.tobytes(), level=9)
    path.write_bytes(PNG_SIGNATURE + _chunk(b"IHDR", header) + _chunk(b"IDAT", body) + _chunk(b"IEND", b""))


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
