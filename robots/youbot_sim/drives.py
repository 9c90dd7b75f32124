"""The drives: the motion of each group of joints. Both simulators follow them."""

from robots.youbot_sim.motion import change_speed, halt, plan
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
    """The motions of each group, one after the other. The caller gives the times."""

    def __init__(self) -> None:
        self._motions: dict[Group, list[tuple[Motion, float]]] = {
            group: [(Motion(START.joints(group), START.joints(group), ()), 0.0)] for group in GROUPS
        }

    def drive(self, drive: Drive, now: float) -> Motion:
        """Move to a goal, and return the motion. If the joints already move to that goal, only the
        speed changes, at once. Otherwise they first come to rest.
        """
        motion, began = self._motion_at(drive.group, now)
        if motion.goal == drive.goal:
            planned = change_speed(motion, now - began, drive)
            self._motions[drive.group] = [(planned, now)]
            return planned
        halted = self.halt(drive.group, now)
        planned = plan(drive, halted.goal)
        self._motions[drive.group].append((planned, now + halted.seconds))
        return Motion(
            halted.goal, drive.goal, (Phase(halted.seconds, 0.0, 0.0, 0.0), *planned.phases)
        )

    def halt(self, group: Group, now: float) -> Motion:
        """Bring a group to rest. Returns the motion."""
        motion, began = self._motion_at(group, now)
        halted = halt(motion, now - began, group)
        self._motions[group] = [(halted, now)]
        return halted

    def joints(self, group: Group, now: float) -> Joints:
        """Return the wanted joint values."""
        motion, began = self._motion_at(group, now)
        return motion.joints(now - began)

    def rates(self, group: Group, now: float) -> Joints:
        """Return the wanted joint speeds."""
        motion, began = self._motion_at(group, now)
        return motion.rates(now - began)

    def is_moving(self, group: Group, now: float) -> bool:
        """Return whether the group's last motion has not ended."""
        motion, began = self._motions[group][-1]
        return now - began < motion.seconds

    def _motion_at(self, group: Group, now: float) -> tuple[Motion, float]:
        """Return the motion at that time, and its start time."""
        motions = self._motions[group]
        return next((item for item in reversed(motions) if item[1] <= now), motions[0])
