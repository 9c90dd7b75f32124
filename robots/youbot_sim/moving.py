"""A module that moves one group of joints: the same for base, arm and gripper."""

import sys
from dataclasses import replace
from typing import cast

from robots.youbot_sim.messages import (
    DID_NOT_ARRIVE,
    DRIVE,
    HALT,
    MEASURE,
    MOVE_ARM,
    MOVE_BASE,
    MOVE_GRIPPER,
    UNKNOWN_POSE,
)
from robots.youbot_sim.places import POSES
from robots.youbot_sim.vocabulary import Drive, Group, Joints, Move
from tca_module import Module, Task

MOVES = {"base": MOVE_BASE, "arm": MOVE_ARM, "gripper": MOVE_GRIPPER}

REPORTS = 20
"""The number of reports of progress in a move."""

TOLERANCE: dict[Group, float] = {"base": 0.02, "arm": 0.03, "gripper": 0.03}
"""The allowed distance from the goal. For the gripper it includes the width of a held object."""

INSTANT = 1e-6
"""Seconds too short to wait for."""

SETTLING = 0.05
"""Seconds between two measurements of joints that lag behind."""

PATIENCE = 20
"""The greatest number of such measurements."""


def make_module(group: Group) -> Module:
    """Make the module that moves *group*."""
    module = Module(group)

    @module.handles(MOVES[group], takes=["update", "cancel"])
    def move(task: Task, wanted: Move) -> None:
        goal = _joints_of_goal(group, wanted)
        try:
            if _drive_to(task, wanted.to, Drive(group, goal, wanted.speed)):
                _settle(task, group, goal)
                return
        except BaseException:
            with task.shielded():  # a killed move, too, leaves its joints at rest
                task.query(HALT, group)
            raise
        task.sleep(task.query(HALT, group).seconds)
        raise task.aborted()

    return module


def _joints_of_goal(group: Group, wanted: Move) -> Joints:
    if wanted.to not in POSES[group]:
        raise UNKNOWN_POSE(
            wanted.to, f"the {group} knows {', '.join(POSES[group])}, not '{wanted.to}'"
        )
    return POSES[group][wanted.to]


def _drive_to(task: Task, to: str, drive: Drive) -> bool:
    """Drive to the goal, report progress and handle requests. Returns False if a client cancels."""
    motion, began, done = task.query(DRIVE, drive), task.time(), 0.0
    task.report(0.0)
    while (left := began + motion.seconds - task.time()) > INSTANT:
        request = task.wait_for_request(min(motion.seconds / REPORTS, left))
        share = done + (1 - done) * motion.share(task.time() - began)
        if request is None:
            task.report(min(share, 1.0))
        elif request.transition == "cancel":
            return False
        elif request.goal.to != to:
            request.reject(f"the move goes to '{to}': cancel it first")
        else:
            request.accept()
            motion = task.query(DRIVE, replace(drive, speed=request.goal.speed))
            began, done = task.time(), share
    return True


def _settle(task: Task, group: Group, goal: Joints) -> None:
    """Wait until the joints are at the goal."""
    for _ in range(PATIENCE):
        joints = task.query(MEASURE).joints(group)
        missing = max(abs(a - b) for a, b in zip(joints, goal, strict=True))
        if missing <= TOLERANCE[group]:
            return
        task.sleep(SETTLING)
    raise DID_NOT_ARRIVE(missing, f"the {group} is {missing:.3f} away from its goal")


if __name__ == "__main__":
    make_module(cast("Group", sys.argv[1])).run()
