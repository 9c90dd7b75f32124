"""Photographs from raw renderings: the camera's place, the floor with its lines, and shadows."""

import math

import numpy as np

from robots.rendering import (
    Camera,
    Pixels,
    Rendering,
    camera_in_the_sun,
    ground_places,
    halve,
    near_multiple,
    shadow,
)

SUN = (2.0, -3.0, 6.0)
SUN_DISTANCE = 30.0
SHADOW_SIZE = (450, 450)
FLOOR, WALL = np.array([222.0, 219.0, 211.0]), np.array([243.0, 243.0, 240.0])


def camera_at(x: float, y: float, heading: float) -> Camera:
    """Return a camera to the right of the robot and a little ahead."""
    around = heading - 0.95
    eye = (x + 0.15 + 1.8 * math.cos(around), y + 1.8 * math.sin(around), 1.0)
    target = (x + 0.2 * math.cos(heading), y + 0.2 * math.sin(heading), 0.2)
    return Camera(eye, target, 36.0, near=0.2, far=40.0)


def sun_over(x: float, y: float) -> Camera:
    """Return a camera at the sun. Ground that it does not see lies in shadow."""
    return camera_in_the_sun(SUN, SUN_DISTANCE, (x, y, 0.0), angle=4.5, depth=5.0)


def develop(frame: Rendering, from_sun: Rendering) -> Pixels:
    """Make the finished picture, at half the size. Floor and background are painted here."""
    image = frame.colours.astype(np.float64)
    places = ground_places(frame)
    lines = near_multiple(places[:, :2], 0.5, 0.004).any(axis=1)
    light = np.where(lines, 0.9, 1.0) * shadow(places, from_sun)
    away = np.hypot(*(places[:, :2] - frame.camera.eye[:2]).T)
    far = np.clip(away / 9.0, 0.0, 1.0)[:, None]
    image[frame.ground] = FLOOR * light[:, None] * (1 - far) + WALL * far
    image[~(frame.ground | frame.objects)] = WALL
    return halve(image)
