"""Three missions with checkpoints: each turtle has a task server and a mission of its own, and sees
of the others only their statuses. 1 means: I am where I was to go first; 0: I am home (or have not
begun).

Each waits until the turtles that must have seen its status have answered it with theirs, before it
changes it.
"""

import sys

from tca_behaviours.missions import Mission


def turtle1(mission: Mission) -> None:
    """Goes first."""
    mission.SetStatusSync(status=0)
    mission.GoTo(goal_x=1.0, goal_y=1.0)
    mission.SetStatusSync(status=1)
    mission.WaitForStatusSync(partner="turtle2", status=1)
    mission.WaitForStatusSync(partner="turtle3", status=1)
    mission.GoTo(goal_x=5.0, goal_y=5.0)
    mission.SetStatusSync(status=0)


def turtle2(mission: Mission) -> None:
    """Goes when turtle 1 is there; goes home when turtle 1 is home."""
    mission.SetStatusSync(status=0)
    mission.WaitForStatusSync(partner="turtle1", status=1)
    mission.GoTo(goal_x=9.0, goal_y=1.0)
    mission.SetStatusSync(status=1)
    mission.WaitForStatusSync(partner="turtle3", status=1)
    mission.WaitForStatusSync(partner="turtle1", status=0)
    mission.GoTo(goal_x=9.0, goal_y=9.0)
    mission.SetStatusSync(status=0)


def turtle3(mission: Mission) -> None:
    """Goes when turtle 2 is there; goes home last."""
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
    with Mission(sys.argv[1]) as one:
        MISSIONS[sys.argv[1]](one)
