"""A mission that handles the failure of a task."""

from tca_behaviours.missions import Mission, MissionTaskFailed


def too_far(mission: Mission) -> None:
    """Try to get somewhere in too short a time; then go to a nearer place."""
    try:
        mission.Wait(duration=0.2)
        mission.GoTo(goal_x=11.0, goal_y=11.0, task_timeout=3.0)
    except MissionTaskFailed as error:
        print(f"Task failed with error status: {error.status}: {error}")
        mission.GoTo(goal_x=5.0, goal_y=5.0)
