"""The quick backend: no dynamics, only equilibrium. The body rests on springs under the standing
feet.

Every tick the horizontal pose follows from the loaded feet, which do not slip. Height, roll and
pitch follow from the balance of weight and foot forces. The foot stiffness is that of the physical
model. The result is fully deterministic.
"""

import math

import numpy as np

from robots.ambler_sim.geometry import (
    AMBLER,
    SHAFT_Y,
    SHOULDER_Z,
    Array,
    feet_of,
    rigid_motion,
    to_body,
    to_world,
    unwrap,
)
from robots.ambler_sim.machine.plant import Plant
from robots.ambler_sim.machine.terrain import STANDS_ON, Terrain
from robots.ambler_sim.planning.stability import WEIGHT, centre_of_gravity
from robots.ambler_sim.vocabulary import LEGS, Attitude, Pose, Posture

RAY_STEP = 0.25
LEAST_FEET = 3

NEWTON_STEPS = 40
CLOSE_ENOUGH = 1e-9
REGULARISER = 1e-6 * np.eye(3)
"""Keeps the equations solvable while fewer than three feet touch the ground."""


class KinematicPlant(Plant):
    """A mechanism that is always in equilibrium, for two backends: "kinematic", and "graphical",
    which is shown while it moves.
    """

    tick = 0.025

    def __init__(self, terrain: Terrain, posture: Posture, name: str = "kinematic") -> None:
        self.name = name
        self._terrain = terrain
        self._joints = np.array(posture.joints)
        self._pose = posture.attitude.pose
        self._roll, self._pitch = posture.attitude.roll, posture.attitude.pitch
        self._loads = np.zeros(6)
        self._anchors = to_world(self._pose, feet_of(self._joints))[:, :2]
        self._stand(feet_of(self._joints))

    def drive(self, joints: Array, rates: Array) -> None:  # noqa: ARG002 - no dynamics, no speeds
        """Set the joint positions at once and find the new equilibrium."""
        self._joints = joints.copy()
        feet = feet_of(joints)
        self._carry(feet)
        self._stand(feet)
        free = self._loads <= 0
        self._anchors[free] = to_world(self._pose, feet)[free, :2]

    def joints(self) -> Array:
        """Return the commanded joint values."""
        return self._joints.copy()

    def loads(self) -> Array:
        """Return the spring forces."""
        return self._loads.copy()

    def pushes(self) -> Array:
        """Return the forces of rocks on the feet, as if rocks were as stiff as feet."""
        feet = to_world(self._pose, feet_of(self._joints))
        pushes = np.zeros(len(feet))
        for rock in self._terrain.rocks:
            away = np.hypot(feet[:, 0] - rock.x, feet[:, 1] - rock.y)
            depth = rock.radius + AMBLER.foot_radius - away
            beside = feet[:, 2] < self._terrain.top(rock) - STANDS_ON
            pushes = np.maximum(pushes, np.where(beside, AMBLER.foot_stiffness * depth, 0.0))
        return pushes

    def bumps(self) -> Array:
        """Return the forces of rocks on links and body, as if rocks were as stiff as feet."""
        rocks = [
            rock
            for rock in self._terrain.rocks
            if self._terrain.top(rock) > self._pose.height - AMBLER.belly
        ]
        if not rocks:
            return np.zeros(len(LEGS) + 1)
        places = np.array([[rock.x, rock.y, self._terrain.top(rock)] for rock in rocks])
        tops, radii = to_body(self._pose, places), np.array([rock.radius for rock in rocks])
        depths = np.array([*_into_beams(self._joints, tops, radii), _into_body(tops, radii)])
        return AMBLER.foot_stiffness * depths.clip(min=0.0)

    def attitude(self) -> Attitude:
        """Return the pose in equilibrium."""
        return Attitude(self._pose, self._roll, self._pitch)

    def close(self) -> None:
        """Nothing to free."""

    def cast(self, origin: Array, directions: Array, limit: float) -> Array:
        """March along each ray until it is below the ground, then interpolate the last interval."""
        distances = np.arange(RAY_STEP, limit, RAY_STEP)
        places = origin[:, None, None] + directions.T[:, :, None] * distances
        above = places[2] - self._terrain.heights_at(places[0], places[1])
        below = above < 0
        first = below.argmax(axis=1)
        rays = np.arange(len(directions))
        high, low = above[rays, np.maximum(first - 1, 0)], above[rays, first]
        share = np.divide(high, high - low, out=np.zeros_like(high), where=high > low)
        return np.where(
            below.any(axis=1) & (first > 0), distances[first] - RAY_STEP * (1 - share), np.nan
        )

    def _carry(self, feet: Array) -> None:
        """Fit the horizontal pose so that the loaded feet are on their anchors (least squares)."""
        firm = self._loads > 0
        if firm.sum() < LEAST_FEET:
            return
        heading, (x, y) = rigid_motion(feet[firm, :2], self._anchors[firm])
        self._pose = Pose(
            float(x), float(y), unwrap(heading, self._pose.heading), self._pose.height
        )

    def _stand(self, feet: Array) -> None:
        """Find the height, roll and pitch at which the springs of the feet bear the weight."""
        places = to_world(self._pose, feet)
        places[:, :2] = np.where((self._loads > 0)[:, None], self._anchors, places[:, :2])
        wanted = self._terrain.under(places) - feet[:, 2]
        arms = np.stack([np.ones(len(feet)), feet[:, 1], -feet[:, 0]], axis=1)
        x, y, _ = centre_of_gravity(self._joints)
        pull = WEIGHT / AMBLER.foot_stiffness * np.array([1.0, y, -x])
        firmness = self._terrain.firmness_at(places[:, 0], places[:, 1])
        now = np.array([self._pose.height, self._roll, self._pitch])
        height, self._roll, self._pitch = map(
            float, _equilibrium(arms, wanted, firmness, pull, now)
        )
        sunk = wanted - arms @ (height, self._roll, self._pitch)
        self._loads = AMBLER.foot_stiffness * firmness * sunk.clip(min=0.0)
        self._pose = Pose(self._pose.x, self._pose.y, self._pose.heading, height)


def _into_beams(joints: Array, tops: Array, radii: Array) -> list[float]:
    """Return how deep (m) each leg's beams are in the nearest rock that reaches them (body
    frame).
    """
    depths = []
    for leg, (angle, reach, _) in enumerate(joints):
        along = np.array([math.cos(angle), math.sin(angle)])
        away = tops[:, :2] - [0.0, SHAFT_Y[leg]]
        nearest = (away @ along).clip(0.0, reach)[:, None] * along
        depth = radii + AMBLER.beam_width / 2 - np.hypot(*(away - nearest).T)
        depths.append(
            float(np.where(tops[:, 2] > SHOULDER_Z[leg] - AMBLER.beam_width / 2, depth, 0.0).max())
        )
    return depths


def _into_body(tops: Array, radii: Array) -> float:
    """Return how deep (m) the body is in the nearest rock that reaches up to it."""
    half = np.array([AMBLER.body_length / 2, AMBLER.shaft_offset + AMBLER.body_length / 4])
    outside = (np.abs(tops[:, :2]) - half).clip(min=0.0)
    return float(np.where(tops[:, 2] > -AMBLER.belly, radii - np.hypot(*outside.T), 0.0).max())


def _equilibrium(arms: Array, wanted: Array, firmness: Array, pull: Array, guess: Array) -> Array:
    """Find the lowest energy of the weight and of six springs that push but do not pull.

    *firmness* is the stiffness of each spring, as a share of a foot's on firm ground. The energy is
    convex and piecewise quadratic. Newton's method therefore converges if it halves each step that
    leads uphill.
    """

    def energy(at: Array) -> float:
        sunk = (wanted - arms @ at).clip(min=0.0)
        return float(sunk @ (firmness * sunk) / 2 + pull @ at)

    for _ in range(NEWTON_STEPS):
        sunk = wanted - arms @ guess
        bears = sunk > 0
        held, stiff = arms[bears], (arms * firmness[:, None])[bears]
        uphill = pull - stiff.T @ sunk[bears]
        if np.abs(uphill).max() < CLOSE_ENOUGH:
            break
        change = np.linalg.solve(stiff.T @ held + REGULARISER, uphill)
        before = energy(guess)
        while energy(guess - change) > before and np.abs(change).max() > CLOSE_ENOUGH:
            change = change / 2
        guess = guess - change
    return guess
