"""A patrol between two places."""

from tca_behaviours.missions import Mission


def patrol(mission: Mission) -> None:
    """Go to and fro until the mission is ended."""
    while True:
        mission.Wait(duration=1.0)
        mission.GoTo(goal_x=1.0, goal_y=1.0)
        mission.Wait(duration=2.0)
        mission.GoTo(goal_x=5.0, goal_y=5.0)


if __name__ == "__main__":
    with Mission("turtle") as turtle:
        patrol(turtle)
