"""The Ambler in PyBullet: rigid-body dynamics, motors, compliant feet."""

import math
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pybullet

from robots.ambler_sim.geometry import AMBLER, Array, unwrap
from robots.ambler_sim.machine.ground_bodies import UNSEEN, GroundBodies
from robots.ambler_sim.machine.plant import Plant, rotation_matrix
from robots.ambler_sim.machine.terrain import Terrain
from robots.ambler_sim.machine.urdf import EFFORT, ambler_urdf
from robots.ambler_sim.pictures import photograph
from robots.ambler_sim.vocabulary import LEGS, Attitude, Foot, Pose, Posture, Rock
from robots.engine import BulletWorld, Engine
from robots.rendering import SIZE, write_png

# Ticks of 1/240 s only take more time. With 10 iterations the feet creep twice as much; 50
# iterations are no better than 20.
TICK = 0.01
ITERATIONS = 20
POSITION_GAIN, VELOCITY_GAIN = 0.1, 1.0
JOINTS_PER_LEG = ("shoulder", "extension", "vertical")

WINDOW = (
    "--width=1200 --height=800"
    " --background_color_red=0.78 --background_color_green=0.85 --background_color_blue=0.92"
)
AWAY, SIDEWAYS, DOWN = 9.0, 50.0, -16.0
"""The camera: metres from the robot, and degrees to the robot's direction and to the horizon."""

CAMERA_PERIOD = 0.04
"""Seconds between two moves of the camera."""


class BulletPlant(BulletWorld, Plant):
    """A simulated mechanism and its ground, in a separate physics world."""

    name = "pybullet"
    tick = TICK
    _sun, _ambient = photograph.SUN, 0.55

    def __init__(self, terrain: Terrain, posture: Posture) -> None:
        self._terrain = terrain
        super().__init__(TICK)
        self._engine.setPhysicsEngineParameter(numSolverIterations=ITERATIONS)
        self._ground = GroundBodies(self._engine, terrain)
        start = posture.attitude.pose
        self._ground.follow(start.x, start.y)
        self._robot = self._load(ambler_urdf())
        self._centre = np.array(self._engine.getDynamicsInfo(self._robot, -1)[3])
        names = self._joint_numbers()
        self._motors = [names[f"{joint}{leg}"] for leg in LEGS for joint in JOINTS_PER_LEG]
        self._feet = [names[f"foot{leg}"] for leg in LEGS]
        self._leg_of_link = {
            motor: number // len(JOINTS_PER_LEG) for number, motor in enumerate(self._motors)
        }
        self._firmness = np.ones(len(LEGS))
        self._prepare_joints()
        self._heading = start.heading
        self._assume(posture)

    def drive(self, joints: Array, rates: Array) -> None:
        """Run the motors for one tick. The *rates* are fed forward so that joints do not lag."""
        if self._terrain.has_soft_ground:
            self._soften_feet()
        self._command(
            targetPositions=joints.ravel().tolist(), targetVelocities=rates.ravel().tolist()
        )
        self._engine.stepSimulation()

    def joints(self) -> Array:
        """Return the joint values that the encoders measure."""
        states = self._engine.getJointStates(self._robot, self._motors)
        return np.array([state[0] for state in states]).reshape(len(LEGS), -1)

    def loads(self) -> Array:
        """Return the loads, from the force sensors between vertical links and feet."""
        return -self._forces()[:, 2]

    def pushes(self) -> Array:
        """Return the horizontal forces, from the same sensors."""
        pushes: Array = np.hypot(*self._forces()[:, :2].T)
        return pushes

    def bumps(self) -> Array:
        """Return the forces on links and body, from their touch sensors. Feet are left out."""
        bumps = np.zeros(len(LEGS) + 1)
        for contact in self._engine.getContactPoints(bodyA=self._robot):
            if contact[3] not in self._feet:
                bumps[self._leg_of_link.get(contact[3], -1)] += contact[9]
        return bumps

    def attitude(self) -> Attitude:
        """Return the true pose of the body, as from a perfect inertial sensor."""
        place, turn = self._engine.getBasePositionAndOrientation(self._robot)
        roll, pitch, heading = pybullet.getEulerFromQuaternion(turn)
        turned = rotation_matrix(Attitude(Pose(0.0, 0.0, heading, 0.0), roll, pitch))
        x, y, z = np.array(place) - turned @ self._centre
        self._heading = unwrap(heading, self._heading)
        self._ground.follow(float(x), float(y))
        return Attitude(Pose(float(x), float(y), self._heading, float(z)), roll, pitch)

    def cast(self, origin: Array, directions: Array, limit: float) -> Array:
        """Cast rays; the scanner does not see the robot's own links."""
        ends = origin + limit * directions
        hits = self._engine.rayTestBatch(
            [origin.tolist()] * len(ends), ends.tolist(), collisionFilterMask=~UNSEEN
        )
        ground = self._ground.tiles
        return np.array([limit * hit[2] if hit[0] in ground else np.nan for hit in hits])

    def add_rock(self, rock: Rock) -> None:
        """Add the rock to the physics world, too."""
        super().add_rock(rock)
        self._ground.add(rock)

    def give_way(self, x: float, y: float) -> None:
        """Lay new tiles there, too."""
        super().give_way(x, y)
        self._ground.remake(x, y)

    def photograph(self, path: Path, trail: Sequence[Foot], size: tuple[int, int]) -> bool:
        """Photograph from ahead and above, rendered twice as large to smooth hard edges."""
        pose = self.attitude().pose
        ground = list(self._ground.tiles)
        frame = self._render(photograph.camera_for(pose), (2 * size[0], 2 * size[1]), ground)
        shadows = photograph.SHADOW_SIZE * size[0] // SIZE[0]
        from_sun = self._render(photograph.sun_over(pose), (shadows, shadows), ground)
        write_png(path, photograph.develop(frame, from_sun, self._terrain, trail))
        return True

    def _soften_feet(self) -> None:
        """Give feet on soft ground softer springs."""
        states = self._engine.getLinkStates(self._robot, self._feet)
        x, y, _ = np.array([state[0] for state in states]).T
        firmness = self._terrain.firmness_at(x, y)
        for leg in np.flatnonzero(firmness != self._firmness):
            self._engine.changeDynamics(
                self._robot,
                self._feet[leg],
                contactStiffness=AMBLER.foot_stiffness * firmness[leg],
                contactDamping=AMBLER.foot_damping * firmness[leg],
            )
        self._firmness = firmness

    def _forces(self) -> Array:
        """Return the forces on the six-axis sensors above the feet, (6, 3). A hanging foot
        pulls.
        """
        states = self._engine.getJointStates(self._robot, self._feet)
        return np.array([state[2][:3] for state in states])

    def _prepare_joints(self) -> None:
        """Set motor limits and gains, and a force sensor above each foot.

        Joints have no damping but that of the motors. Links collide, but the scanner does not see
        them.
        """
        self._command = partial(
            self._engine.setJointMotorControlArray,
            self._robot,
            self._motors,
            pybullet.POSITION_CONTROL,
            forces=[EFFORT[joint] for _ in LEGS for joint in JOINTS_PER_LEG],
            positionGains=[POSITION_GAIN] * len(self._motors),
            velocityGains=[VELOCITY_GAIN] * len(self._motors),
        )
        for link in (-1, *self._motors, *self._feet):
            self._engine.changeDynamics(
                self._robot, link, linearDamping=0, angularDamping=0, jointDamping=0
            )
        for link in (-1, *self._motors):
            self._engine.setCollisionFilterGroupMask(self._robot, link, UNSEEN, -1)
        for foot in self._feet:
            self._engine.enableJointForceTorqueSensor(self._robot, foot)

    def _assume(self, posture: Posture) -> None:
        """Place the body and all joints as in *posture*, at rest."""
        joints, attitude, pose = np.array(posture.joints), posture.attitude, posture.attitude.pose
        place = np.array([pose.x, pose.y, pose.height]) + rotation_matrix(attitude) @ self._centre
        quaternion = pybullet.getQuaternionFromEuler((attitude.roll, attitude.pitch, pose.heading))
        self._engine.resetBasePositionAndOrientation(self._robot, place.tolist(), quaternion)
        for motor, position in zip(self._motors, joints.ravel().tolist(), strict=True):
            self._engine.resetJointState(self._robot, motor, position)
        self.drive(joints, np.zeros_like(joints))


class BulletWindow(BulletPlant):
    """The same plant in PyBullet's own window, for users with a screen. Its camera follows the
    robot.
    """

    def __init__(self, terrain: Terrain, posture: Posture) -> None:
        self._aimed_at = 0.0
        super().__init__(terrain, posture)
        for panel in (pybullet.COV_ENABLE_GUI, pybullet.COV_ENABLE_MOUSE_PICKING):
            self._engine.configureDebugVisualizer(panel, 0)

    def connect(self, tick: float) -> Engine:
        """Open a physics world in a window; a thread of the engine draws it."""
        return Engine(pybullet.GUI, tick, options=WINDOW)

    def attitude(self) -> Attitude:
        """Position and inclination of the body. The camera follows them."""
        attitude = super().attitude()
        if (now := time.monotonic()) > self._aimed_at + CAMERA_PERIOD:
            self._aimed_at = now
            self._aim_at(attitude.pose)
        return attitude

    def _aim_at(self, pose: Pose) -> None:
        """Aim the camera at the robot. The engine's yaw is 0 for a camera that looks along y."""
        yaw = math.degrees(pose.heading) + 90 + SIDEWAYS
        self._engine.resetDebugVisualizerCamera(
            AWAY, yaw, DOWN, (pose.x, pose.y, pose.height - 0.8)
        )
