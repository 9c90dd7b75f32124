"""Explore all orders of events, to find one in which the arm grasps while the base drives.

``tca explore examples/07_explore.py`` prints the same report.
"""

from tca_module import Command, Goal
from tca_tools.explore import (
    Scenario,
    Script,
    Task,
    achieved,
    before,
    begun,
    explore,
    never_stuck,
    report,
)

FETCH, DRIVE, GRASP = Goal("fetch"), Command("drive"), Command("grasp")


def fetching(title: str, *, in_sequence: bool) -> Scenario:
    scenario = Scenario(title, before(achieved(DRIVE), begun(GRASP)), never_stuck())
    planner, user = scenario.module("planner"), scenario.module("user")
    base = scenario.module("base", may_be_lost=1, comes_back=True)
    arm = scenario.module("arm")

    @planner.handles(FETCH)
    def fetch(task: Task) -> None:
        task.command(DRIVE)
        task.command(GRASP, sequential=in_sequence)

    @base.handles(DRIVE)
    @arm.handles(GRASP)
    def act(_: Task) -> None:
        """Do nothing: only the order in which base and arm are done matters."""

    @user.does
    def want_a_cup(me: Script) -> None:
        me.goal(FETCH).wait()

    return scenario


CAREFUL = fetching("a careful robot", in_sequence=True)
HASTY = fetching("a hasty robot", in_sequence=False)

if __name__ == "__main__":
    for scenario in (CAREFUL, HASTY):
        print(report(explore(scenario)))
