"""The drives: what each group of joints is doing. Both simulators follow them."""

from robots.youbot_sim.motion import go_on, halt, plan
from robots.youbot_sim.places import POSES
from robots.youbot_sim.vocabulary import (
    GROUPS,
    Drive,
    Group,
    JointReadings,
    Joints,
    Motion,
    ObjectPlace,
    Phase,
)

START = JointReadings(
    POSES["base"]["A"], POSES["arm"]["home"], POSES["gripper"]["open"], ObjectPlace.NOWHERE
)


class Drives:
    """The motions of each group, one after the other. Times are the caller's."""

    def __init__(self) -> None:
        self._motions: dict[Group, list[tuple[Motion, float]]] = {
            group: [(Motion(START.joints(group), START.joints(group), ()), 0.0)] for group in GROUPS
        }

    def drive(self, drive: Drive, now: float) -> Motion:
        """Go somewhere: to the goal of the present motion at once, to another one when the joints
        have come to rest.
        """
        motion, began = self._at(drive.group, now)
        if motion.goal == drive.goal:
            planned = go_on(motion, now - began, drive)
            self._motions[drive.group] = [(planned, now)]
            return planned
        halted = self.halt(drive.group, now)
        planned = plan(drive, halted.goal)
        self._motions[drive.group].append((planned, now + halted.seconds))
        return Motion(
            halted.goal, drive.goal, (Phase(halted.seconds, 0.0, 0.0, 0.0), *planned.phases)
        )

    def halt(self, group: Group, now: float) -> Motion:
        """Come to rest; how that goes."""
        motion, began = self._at(group, now)
        halted = halt(motion, now - began, group)
        self._motions[group] = [(halted, now)]
        return halted

    def joints(self, group: Group, now: float) -> Joints:
        """Where the joints are to be."""
        motion, began = self._at(group, now)
        return motion.joints(now - began)

    def rates(self, group: Group, now: float) -> Joints:
        """How fast they are to be."""
        motion, began = self._at(group, now)
        return motion.rates(now - began)

    def is_moving(self, group: Group, now: float) -> bool:
        """Whether its last motion goes on."""
        motion, began = self._motions[group][-1]
        return now - began < motion.seconds

    def _at(self, group: Group, now: float) -> tuple[Motion, float]:
        """The motion at that time, and its beginning."""
        motions = self._motions[group]
        return next((one for one in reversed(motions) if one[1] <= now), motions[0])
