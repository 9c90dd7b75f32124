"""The shape of unbounded ground from a seed: hills, and boulders or ditches on them. Pure functions
of x and y.

Hills are the sum of small waves and of two profiles, along axes at right angles to each other. A
profile goes up and down in turn, in pieces of random length and steepness. Every second piece has
the greatest steepness allowed. No place is therefore steeper than the given slope, but any longer
walk passes places of that slope.
"""

import math
from collections.abc import Callable
from random import Random

import numpy as np

from robots.ambler_sim.geometry import Array
from robots.plane import seen_from

REACH = 2000.0
"""How far (m) from the start hills extend."""

SHORTEST, LONGEST = 6.0, 13.0
BEND = 1.2
"""Half the distance (m) over which one steepness changes into the next."""

CALM = 4.0
"""Radius (m) of gentle ground around the start."""

START_ROOM = 7.0
"""Radius (m) around the start without boulders and ditches."""

MAIN_SHARE = 0.95
"""The profiles' share of the slope; the small waves have the rest."""

BOULDER_CELL, BOULDER_SHARE = 6.0, 0.5
DITCH_SPACING, DITCH_DEPTH, DITCH_HALF_WIDTH, DITCH_SIDE = 19.0, 0.5, 0.35, 0.3
SOFT_CELL, SOFT_SHARE, SOFT_FIRMNESS = 5.0, 0.35, 0.35


class Profile:
    """Heights along one axis: a line whose steepness is piecewise linear."""

    def __init__(self, random: Random, steepest: float) -> None:
        knots, slopes = [-CALM], [0.0]
        for side in (1, -1):
            at, sign, number = CALM, random.choice((1, -1)), 0
            places, values = [CALM], [0.0]
            while at < REACH:
                end = at + random.uniform(SHORTEST, LONGEST)
                steepness = steepest * sign * (1.0 if number % 2 == 0 else random.uniform(0.2, 0.9))
                places += [at + 2 * BEND, end]
                values += [steepness, steepness]
                at, sign, number = end, -sign, number + 1
            if side > 0:
                knots, slopes = knots + places, slopes + values
            else:
                knots = [-x for x in reversed(places[1:])] + knots
                slopes = [-s for s in reversed(values[1:])] + slopes
        self._knots, self._slopes = np.array(knots), np.array(slopes)
        rises = np.diff(self._knots) * (self._slopes[1:] + self._slopes[:-1]) / 2
        self._heights = np.concatenate([[0.0], np.cumsum(rises)])
        self._heights -= np.interp(0.0, self._knots, self._heights)

    def heights(self, t: Array) -> Array:
        """Return the heights at these distances along the axis."""
        t = np.clip(t, self._knots[0], self._knots[-1])
        piece = np.clip(np.searchsorted(self._knots, t, side="right") - 1, 0, len(self._knots) - 2)
        along = t - self._knots[piece]
        bend = (self._slopes[piece + 1] - self._slopes[piece]) / (
            self._knots[piece + 1] - self._knots[piece]
        )
        heights: Array = self._heights[piece] + along * (self._slopes[piece] + along * bend / 2)
        return heights


class Relief:
    """The ground of one kind and seed; *slope* is the steepest rise per run."""

    def __init__(self, kind: str, seed: int, slope: float) -> None:
        self.kind, self.seed = kind, seed
        random = Random(f"{seed}")  # noqa: S311 - hills need no secrets
        self._turn = math.pi / 4 + random.uniform(-0.2, 0.2)
        steepest = MAIN_SHARE * slope / math.sqrt(2)
        self._profiles = Profile(random, steepest), Profile(random, steepest)
        self._waves = [_wave(random, (1 - MAIN_SHARE) * slope / 4) for _ in range(4)]
        self._has_relief = slope > 0

    def heights(self, x: Array, y: Array) -> Array:
        """Return the heights at these points."""
        heights = np.zeros(np.broadcast(x, y).shape)
        if self._has_relief:
            first, second = self._profiles
            along, across = seen_from(0.0, 0.0, self._turn, x, y)
            heights += first.heights(along) + second.heights(across)
            for wave in self._waves:
                heights += wave(x, y)
        if self.kind == "boulders":
            heights += self._boulders(x, y)
        if self.kind == "ditches":
            heights -= _ditches(x + 0.15 * y)
        return heights

    def firmness(self, x: Array, y: Array) -> Array:
        """Return the factor of the feet's stiffness at these points: 1 on firm ground."""
        if self.kind != "soft":
            return np.ones(np.broadcast(x, y).shape)
        discs = self._discs("soft", SOFT_CELL, SOFT_SHARE, x, y)
        return np.where(discs > 0, SOFT_FIRMNESS, 1.0)

    def _boulders(self, x: Array, y: Array) -> Array:
        """Round humps of 0.25 to 0.5 m."""
        discs = self._discs("boulder", BOULDER_CELL, BOULDER_SHARE, x, y)
        humps: Array = np.where(
            discs > 0, (0.25 + 0.25 * discs) * np.sqrt(np.maximum(discs, 0.0)), 0.0
        )
        return humps

    def _discs(self, name: str, cell: float, share: float, x: Array, y: Array) -> Array:
        """Return how far inside a scattered disc each point is: 1 in its middle, 0 or less
        outside.
        """
        x, y = np.broadcast_arrays(x, y)
        row, column = np.floor(x / cell).astype(int), np.floor(y / cell).astype(int)
        inside = np.full(x.shape, -1.0)
        for i, j in set(zip(row.ravel().tolist(), column.ravel().tolist(), strict=True)):
            random = Random(f"{name} {self.seed} {i} {j}")  # noqa: S311
            radius = random.uniform(0.4, 0.8)
            middle_x = (i + random.uniform(0.2, 0.8)) * cell
            middle_y = (j + random.uniform(0.2, 0.8)) * cell
            if random.random() < share and math.hypot(middle_x, middle_y) > START_ROOM:
                here = (row == i) & (column == j)
                away = np.hypot(x[here] - middle_x, y[here] - middle_y)
                inside[here] = 1.0 - away / radius
        return inside


def _wave(random: Random, steepness: float) -> Callable[[Array, Array], Array]:
    """Return the heights of waves of one length and direction."""
    length, direction = random.uniform(2.5, 6.0), random.uniform(0.0, math.pi)
    phase = random.uniform(0, math.tau)
    number = math.tau / length
    along_x, along_y = number * math.cos(direction), number * math.sin(direction)
    return lambda x, y: steepness / number * np.sin(along_x * x + along_y * y + phase)


def _ditches(along: Array) -> Array:
    """Trenches with sloping sides, across the way."""
    middle = np.round(along / DITCH_SPACING) * DITCH_SPACING
    away = np.abs(along - middle)
    depth = DITCH_DEPTH * np.clip((DITCH_HALF_WIDTH + DITCH_SIDE - away) / DITCH_SIDE, 0.0, 1.0)
    return np.where(np.abs(middle) < START_ROOM, 0.0, depth)
