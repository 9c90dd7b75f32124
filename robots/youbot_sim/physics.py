"""The robot in PyBullet: rigid bodies, motors, a grip by friction. No other file uses PyBullet."""

import math
from pathlib import Path

import pybullet

from robots.engine import BulletWorld
from robots.plane import world_place
from robots.rendering import RENDERED_SIZE, write_png
from robots.urdf import Triple
from robots.youbot_sim import photograph
from robots.youbot_sim.drives import START, Drives
from robots.youbot_sim.kinematics import tip_in_world
from robots.youbot_sim.places import BOX_B, BOXES, OBJECT, DropBox
from robots.youbot_sim.urdf import EFFORT, youbot_urdf
from robots.youbot_sim.vocabulary import GROUPS, Group, JointReadings, Joints, ObjectPlace

Quadruple = tuple[float, float, float, float]

TICK = 1 / 240
MASS = 0.15
"""The mass of the object (kg)."""

NEAR = 0.05
"""An object at most this far (m) from the fingertips is between them."""

MOTORS: dict[Group, tuple[str, ...]] = {
    "base": ("x", "y", "heading"),
    "arm": ("arm1", "arm2", "arm3", "arm4", "arm5"),
    "gripper": ("finger1", "finger2"),
}
BOX_COLOUR: Quadruple = (0.42, 0.56, 0.72, 1)
"""The colour of the boxes; the floor has it too, but photographs paint it over."""

LID_COLOUR: Quadruple = (0.35, 0.38, 0.42, 1)
OBJECT_COLOUR: Quadruple = (0.16, 0.62, 0.34, 1)


class BulletManipulator(BulletWorld):
    """A simulated robot, its floor and boxes, in a separate physics world."""

    name = "pybullet"
    _sun, _ambient = photograph.SUN, 0.6

    def __init__(self) -> None:
        super().__init__(TICK)
        self._floor = self._make_body((60.0, 60.0, 0.2), (0.0, 0.0, -0.1), BOX_COLOUR)
        for box in BOXES:
            self._make_box(box)
        self._robot = self._load(youbot_urdf(), is_fixed=True)
        self._joints = self._joint_numbers()
        self._time: float | None = None
        self._lid: int | None = None
        self._object: int | None = None
        self._holder: int | None = None  # the constraint that holds an offered object
        self.assume(START)

    def follow(self, drives: Drives, now: float) -> None:
        """Step the world; the motors follow the drives."""
        if self._time is None:
            self._time = now
        while self._time + TICK <= now:
            self._time += TICK
            for group in GROUPS:
                self._command(group, drives, self._time)
            self._engine.stepSimulation()
        if (
            self._holder is not None
            and self._has_gripped()
            and not drives.is_moving("gripper", now)
        ):
            self._engine.removeConstraint(self._holder)
            self._holder = None

    def measured(self) -> JointReadings:
        """Return the values of the encoders, and the true place of the object."""
        base, arm, fingers = (self._positions(group) for group in GROUPS)
        return JointReadings(base, arm, (sum(fingers),), self._object_place(base, arm))

    def assume(self, readings: JointReadings) -> None:
        """Set all joints to these values."""
        for group in GROUPS:
            for joint, value in zip(
                MOTORS[group], _per_motor(group, readings.joints(group)), strict=True
            ):
                self._engine.resetJointState(self._robot, self._joints[joint], value)
        if readings.object is ObjectPlace.HELD:
            self._make_object(readings)

    def offer(self) -> None:
        """Create an object that is held in place until the fingers grip it."""
        self._object, place, turn = self._make_object(self.measured())
        to_world, origin = (self._object, -1, -1, -1), (0, 0, 0)
        self._holder = self._engine.createConstraint(
            *to_world, pybullet.JOINT_FIXED, origin, origin, place, childFrameOrientation=turn
        )

    def _make_object(self, readings: JointReadings) -> tuple[int, Triple, Quadruple]:
        """Make an object between the fingers. Returns its body, place and orientation."""
        place = tip_in_world(readings.base, readings.arm)
        lean, heading = sum(readings.arm[1:4]), readings.base[2] + readings.arm[0]
        turn = pybullet.getQuaternionFromEuler((0.0, lean, heading))
        body = self._make_body(OBJECT, place, OBJECT_COLOUR, MASS, turn)
        self._engine.changeDynamics(body, -1, lateralFriction=2.0, spinningFriction=0.05)
        return body, place, turn

    def cover(self, *, is_covered: bool) -> None:
        """Put a lid on box B, or take it off."""
        if is_covered and self._lid is None:
            size, above = (BOX_B.side, BOX_B.side, 0.012), (0.0, 0.0, BOX_B.height + 0.006)
            self._lid = self._make_part(BOX_B, size, above, LID_COLOUR)
        elif not is_covered and self._lid is not None:
            self._engine.removeBody(self._lid)
            self._lid = None

    def picture(self, path: Path) -> Path:
        """Return a photograph from the side and above, as PNG."""
        x, y, heading = self._positions("base")
        frame = self._render(photograph.camera_at(x, y, heading), RENDERED_SIZE, [self._floor])
        from_sun = self._render(photograph.sun_over(x, y), photograph.SHADOW_SIZE, [self._floor])
        written = path.with_suffix(".png")
        write_png(written, photograph.develop(frame, from_sun))
        return written

    # --- motors and sensors -----------------------------------------------------------------------

    def _command(self, group: Group, drives: Drives, time: float) -> None:
        motors = [self._joints[name] for name in MOTORS[group]]
        self._engine.setJointMotorControlArray(
            self._robot,
            motors,
            pybullet.POSITION_CONTROL,
            targetPositions=_per_motor(group, drives.joints(group, time)),
            targetVelocities=_per_motor(group, drives.rates(group, time)),
            forces=[EFFORT[group]] * len(motors),
            positionGains=[0.3] * len(motors),
            velocityGains=[1.0] * len(motors),
        )

    def _positions(self, group: Group) -> Joints:
        motors = [self._joints[name] for name in MOTORS[group]]
        return tuple(state[0] for state in self._engine.getJointStates(self._robot, motors))

    def _has_gripped(self) -> bool:
        """Return whether both fingers touch the object."""
        touching = {
            contact[3]
            for contact in self._engine.getContactPoints(self._robot, self._object)
            if contact[9] > 0
        }
        return {self._joints["finger1"], self._joints["finger2"]} <= touching

    def _object_place(self, base: Joints, arm: Joints) -> ObjectPlace:
        if self._object is None:
            return ObjectPlace.NOWHERE
        if self._holder is not None:
            return ObjectPlace.OFFERED
        place, _ = self._engine.getBasePositionAndOrientation(self._object)
        if math.dist(place, tip_in_world(base, arm)) < NEAR:
            return ObjectPlace.HELD
        x, y, height = place
        return next(
            (box.place for box in BOXES if box.holds(x, y) and height < box.height),
            ObjectPlace.FLOOR,
        )

    # --- bodies -----------------------------------------------------------------------------------

    def _make_body(
        self,
        size: Triple,
        place: Triple,
        colour: Quadruple,
        mass: float = 0.0,
        turn: Quadruple = (0, 0, 0, 1),
    ) -> int:
        """Make a solid block. Without mass it does not move."""
        half = [side / 2 for side in size]
        shape = self._engine.createCollisionShape(pybullet.GEOM_BOX, halfExtents=half)
        look = self._engine.createVisualShape(pybullet.GEOM_BOX, halfExtents=half, rgbaColor=colour)
        body: int = self._engine.createMultiBody(mass, shape, look, place, turn)
        return body

    def _make_box(self, box: DropBox) -> None:
        """Make a box of a bottom and four walls."""
        across, thick = box.side, box.wall
        offset, middle = (box.size + thick) / 2, box.height / 2
        parts = [((across, across, thick), (0.0, 0.0, thick / 2))]
        parts += [((thick, across, box.height), (side * offset, 0.0, middle)) for side in (1, -1)]
        parts += [((across, thick, box.height), (0.0, side * offset, middle)) for side in (1, -1)]
        for size, place in parts:
            self._make_part(box, size, place, BOX_COLOUR)

    def _make_part(self, box: DropBox, size: Triple, place: Triple, colour: Quadruple) -> int:
        """Make a part of a box, at a place relative to the box."""
        ahead, left, up = place
        turn = pybullet.getQuaternionFromEuler((0, 0, box.heading))
        world = (*world_place(box.x, box.y, box.heading, ahead, left), up)
        return self._make_body(size, world, colour, turn=turn)


def _per_motor(group: Group, joints: Joints) -> list[float]:
    """Return the values of each motor. Each finger has half of the gap."""
    return [joints[0] / 2] * 2 if group == "gripper" else list(joints)
