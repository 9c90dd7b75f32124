"""Three missions with checkpoints. Each turtle has a task server and a mission, and sees only the
statuses of the others.

Status 1 means that the turtle is at its first goal; 0 means that it is at home or has not begun. A
turtle keeps a status until the partners that wait for it have answered with new statuses of their
own.
"""

import sys

from tca_behaviours.missions import Mission


def turtle1(mission: Mission) -> None:
    """The first turtle to go."""
    mission.SetStatusSync(status=0)
    mission.GoTo(goal_x=1.0, goal_y=1.0)
    mission.SetStatusSync(status=1)
    mission.WaitForStatusSync(partner="turtle2", status=1)
    mission.WaitForStatusSync(partner="turtle3", status=1)
    mission.GoTo(goal_x=5.0, goal_y=5.0)
    mission.SetStatusSync(status=0)


def turtle2(mission: Mission) -> None:
    """Goes when turtle 1 has arrived; goes home when turtle 1 is home."""
    mission.SetStatusSync(status=0)
    mission.WaitForStatusSync(partner="turtle1", status=1)
    mission.GoTo(goal_x=9.0, goal_y=1.0)
    mission.SetStatusSync(status=1)
    mission.WaitForStatusSync(partner="turtle3", status=1)
    mission.WaitForStatusSync(partner="turtle1", status=0)
    mission.GoTo(goal_x=9.0, goal_y=9.0)
    mission.SetStatusSync(status=0)


def turtle3(mission: Mission) -> None:
    """Goes when turtle 2 has arrived; goes home last."""
    mission.SetStatusSync(status=0)
    mission.WaitForStatusSync(partner="turtle2", status=1)
    mission.GoTo(goal_x=1.0, goal_y=9.0)
    mission.SetStatusSync(status=1)
    mission.WaitForStatusSync(partner="turtle1", status=0)
    mission.WaitForStatusSync(partner="turtle2", status=0)
    mission.GoTo(goal_x=1.0, goal_y=1.0)
    mission.SetStatusSync(status=0)


MISSIONS = {"turtle1": turtle1, "turtle2": turtle2, "turtle3": turtle3}

if __name__ == "__main__":
    with Mission(sys.argv[1]) as mission:
        MISSIONS[sys.argv[1]](mission)
