"""Moves the arm."""

from robots.youbot_sim.messages import MOVE_ARM
from robots.youbot_sim.moving import make_module

arm = make_module("arm", MOVE_ARM)

if __name__ == "__main__":
    arm.run()
