"""Simulates the robot and its boxes."""

import argparse
from typing import cast

from robots.youbot_sim.robot import Physics, make_robot
from robots.youbot_sim.simulator import Lid, SimulatedRobot, make_module


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m robots.youbot_sim.modules.simulator", description=__doc__)
    parser.add_argument("--backend", choices=("auto", "pybullet", "kinematic"), default="auto")
    parser.add_argument("--covered", action="store_true", help="box B has its lid on at first")
    parser.add_argument(
        "--change", type=float, action="append", default=[], metavar="SECONDS",
        help="so long after the object was offered the lid is put on, or taken off; may be given several times",
    )  # fmt: skip
    options = parser.parse_args()
    robot = make_robot(cast("Physics", options.backend))
    lid = Lid(tuple(options.change), starts_covered=options.covered)
    try:
        make_module(SimulatedRobot(robot, lid), has_steps=robot.name == "pybullet").run()
    finally:
        robot.close()


if __name__ == "__main__":
    main()
