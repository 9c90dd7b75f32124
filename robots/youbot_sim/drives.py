"""The drives: what each group of joints is doing. Both simulators follow them."""

from robots.youbot_sim.motion import go_on, halt, plan
from robots.youbot_sim.places import POSES
from robots.youbot_sim.vocabulary import GROUPS, Drive, Group, Joints, Motion

START: dict[Group, Joints] = {
    "base": POSES["base"]["A"],
    "arm": POSES["arm"]["home"],
    "gripper": POSES["gripper"]["open"],
}


class Drives:
    """One motion for each group. Times are the caller's."""

    def __init__(self) -> None:
        self._motions: dict[Group, tuple[Motion, float]] = {
            group: (Motion(START[group], START[group], ()), 0.0) for group in GROUPS
        }

    def drive(self, drive: Drive, now: float) -> Motion:
        """Go somewhere from now on; to the goal of the present motion at once, to another one from rest."""
        motion, began = self._motions[drive.group]
        if motion.goal == drive.goal:
            planned = go_on(motion, now - began, drive)
        else:
            planned = plan(drive, motion.joints(now - began))
        self._motions[drive.group] = planned, now
        return planned

    def halt(self, group: Group, now: float) -> Motion:
        """Come to rest; how that goes."""
        motion, began = self._motions[group]
        self._motions[group] = halt(motion, now - began, group), now
        return self._motions[group][0]

    def joints(self, group: Group, now: float) -> Joints:
        """Where the joints are to be."""
        motion, began = self._motions[group]
        return motion.joints(now - began)

    def rates(self, group: Group, now: float) -> Joints:
        """How fast they are to be."""
        motion, began = self._motions[group]
        return motion.rates(now - began)

    def is_moving(self, group: Group, now: float) -> bool:
        """Whether its motion goes on."""
        motion, began = self._motions[group]
        return now - began < motion.seconds
