"""Moves the gripper."""

from robots.youbot_sim.messages import MOVE_GRIPPER
from robots.youbot_sim.moving import make_module

gripper = make_module("gripper", MOVE_GRIPPER)

if __name__ == "__main__":
    gripper.run()
