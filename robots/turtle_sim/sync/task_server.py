"""The task server of one turtle of a team: ``... turtle1 team.toml``."""

import argparse

from robots.turtle_sim.errors import BadTeam
from robots.turtle_sim.sync.environment import SyncEnvironment
from robots.turtle_sim.sync.link import StatusLink
from robots.turtle_sim.sync.tasks import TASKS_OF_TEAMS
from robots.turtle_sim.sync.team import load_team
from robots.turtle_sim.task_server import TASKS
from tca_behaviours.missions import TaskServer


def main() -> None:
    """Serve until told to end."""
    parser = argparse.ArgumentParser(description="The task server of one turtle of a team.")
    parser.add_argument("name", help="of the turtle")
    parser.add_argument("team", help="the file with the addresses of all")
    parser.add_argument(
        "--rate", type=float, default=10.0, help="iterations a second (default: %(default)s)"
    )
    parser.add_argument(
        "--loss", type=float, default=0.0, help="part of its datagrams to throw away, for trials"
    )
    given = parser.parse_args()
    try:
        with StatusLink(given.name, load_team(given.team), loss=given.loss) as link:
            TaskServer(
                given.name, SyncEnvironment(link), TASKS_OF_TEAMS, folder=TASKS, rate=given.rate
            ).run()
            print(f"{link.sent:,} datagrams sent, {link.lost:,} of them lost")
    except BadTeam as error:
        parser.error(str(error))


if __name__ == "__main__":
    main()
