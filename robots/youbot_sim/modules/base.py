"""Moves the base."""

from robots.youbot_sim.messages import MOVE_BASE
from robots.youbot_sim.moving import make_module

base = make_module("base", MOVE_BASE)

if __name__ == "__main__":
    base.run()
