"""Raw renderings of a physics engine, and parts of pictures: shadows, lines, PNG files."""

import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageFilter

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]
Mask = NDArray[np.bool_]
Triple = tuple[float, float, float]

SIZE = (960, 600)
RENDERED_SIZE = (2 * SIZE[0], 2 * SIZE[1])
"""The size of renderings, twice that of pictures: ``halve`` smooths the renderer's hard edges."""

SHADOW = 0.58
"""The brightness of ground in shadow, where sunlit ground has 1."""


@dataclass(frozen=True, slots=True)
class Camera:
    """A camera: place, target, vertical angle of view in degrees, and the distances it shows."""

    eye: Triple
    target: Triple
    angle: float
    near: float
    far: float


@dataclass(frozen=True, eq=False)
class Rendering:
    """One rendering: RGB colours, depths (0 near to 1 far), masks of the ground and of objects on
    it, the world-to-screen matrix and the camera.
    """

    colours: Pixels = field(repr=False)
    depths: Array = field(repr=False)
    ground: Mask = field(repr=False)
    objects: Mask = field(repr=False)
    to_screen: Array
    camera: Camera


def camera_in_the_sun(
    sun: Triple, distance: float, target: Triple, angle: float, depth: float
) -> Camera:
    """Return a camera in the direction *sun* from the target. Ground that it does not see lies in
    shadow.

    It shows everything up to *depth* metres before and behind the target.
    """
    x, y, z = (a + distance * b / math.hypot(*sun) for a, b in zip(target, sun, strict=True))
    return Camera((x, y, z), target, angle, near=distance - depth, far=distance + depth)


def ground_places(frame: Rendering) -> Array:
    """Return the world point (n, 3) seen in each ground pixel, from its depth."""
    row, column = np.nonzero(frame.ground)
    height, width = frame.ground.shape
    across, down = 2 * (column + 0.5) / width - 1, 1 - 2 * (row + 0.5) / height
    screen = np.stack([across, down, 2 * frame.depths[frame.ground] - 1, np.ones(len(row))])
    world = np.linalg.inv(frame.to_screen) @ screen
    places: Array = (world[:3] / world[3]).T
    return places


def near_multiple(values: Array, step: float, width: float) -> Mask:
    """Mask the values that are nearer than *width* to a multiple of *step*."""
    near: Mask = np.abs(values - step * np.round(values / step)) < width
    return near


def shadow(places: Array, from_sun: Rendering) -> Array:
    """Return the brightness of places of the ground: SHADOW where an object hides them from the
    sun.

    Shadows have soft edges. Places outside the sun's rendering are lit.
    """
    height, width = from_sun.objects.shape
    x, y, _, w = from_sun.to_screen @ np.vstack([places.T, np.ones(len(places))])
    column = ((x / w + 1) / 2 * width).astype(np.intp)
    row = ((1 - y / w) / 2 * height).astype(np.intp)
    is_rendered = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    hidden = _blurred(from_sun.objects)[row.clip(0, height - 1), column.clip(0, width - 1)]
    return np.where(is_rendered, 1 - (1 - SHADOW) * hidden, 1.0)


def _blurred(cells: Mask) -> Array:
    """Return the mean over 5 by 5 cells."""
    image = Image.fromarray(255 * cells.astype(np.uint8))
    return np.asarray(image.filter(ImageFilter.BoxBlur(2))) / 255


def halve(image: Array) -> Pixels:
    """Halve the size: each pixel becomes the mean of four."""
    return np.asarray(Image.fromarray(image.round().clip(0, 255).astype(np.uint8)).reduce(2))


def write_png(path: Path, pixels: Pixels) -> None:
    """Write (height, width, 3) pixels as PNG."""
    Image.fromarray(pixels).save(path, "PNG")
