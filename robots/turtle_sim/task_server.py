"""The task server of a single turtle."""

import argparse
from pathlib import Path

from robots.turtle_sim.environment import TurtleEnvironment
from tca_behaviours.missions import TaskServer

TASKS = Path(__file__).parent / "tasks"


def main() -> None:
    """Serve until the program is stopped."""
    parser = argparse.ArgumentParser(description="The task server of a turtle.")
    parser.add_argument(
        "name", nargs="?", default="turtle", help="name of the server (default: %(default)s)"
    )
    parser.add_argument(
        "--rate", type=float, default=10.0, help="iterations a second (default: %(default)s)"
    )
    options = parser.parse_args()
    TaskServer(options.name, TurtleEnvironment(), folder=TASKS, rate=options.rate).run()


if __name__ == "__main__":
    main()
