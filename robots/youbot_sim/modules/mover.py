"""Moves the arm, the base or the gripper, as its argument says."""

import sys

from robots.youbot_sim.messages import MOVE_ARM, MOVE_BASE, MOVE_GRIPPER
from robots.youbot_sim.moving import make_module

MODULES = make_module("arm", MOVE_ARM), make_module("base", MOVE_BASE), make_module("gripper", MOVE_GRIPPER)

if __name__ == "__main__":
    next(module for module in MODULES if module.name == sys.argv[1]).run()
