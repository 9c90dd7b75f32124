"""The task server of one turtle of a team: ``... turtle1 team.toml``."""

import argparse

from robots.turtle_sim.errors import BadTeam
from robots.turtle_sim.sync.environment import SyncEnvironment
from robots.turtle_sim.sync.link import StatusLink
from robots.turtle_sim.sync.tasks import TASKS_OF_TEAMS
from robots.turtle_sim.task_server import TASKS
from tca_behaviours.missions import TaskServer


def main() -> None:
    """Serve until the program is stopped."""
    parser = argparse.ArgumentParser(description="The task server of one turtle of a team.")
    parser.add_argument("name", help="name of the turtle")
    parser.add_argument("team", help="the file with the addresses of all turtles")
    parser.add_argument("--rate", type=float, default=10.0, help="iterations a second (10)")
    parser.add_argument("--loss", type=float, default=0.0, help="share of datagrams to drop")
    options = parser.parse_args()
    try:
        with StatusLink.from_file(options.name, options.team, loss=options.loss) as link:
            environment, rate = SyncEnvironment(link), options.rate
            TaskServer(options.name, environment, TASKS_OF_TEAMS, folder=TASKS, rate=rate).run()
            print(f"{link.sent:,} datagrams sent, {link.lost:,} of them lost")
    except BadTeam as error:
        parser.error(str(error))


if __name__ == "__main__":
    main()
