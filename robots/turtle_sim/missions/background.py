"""Tasks in the background, beside the one in the foreground."""

from tca_behaviours.missions import Mission


def background(mission: Mission) -> str:
    """Visit two places. Returns which of them the turtle has reached first."""
    left = mission.WaitForROI(foreground=False, roi_x=1.0, roi_y=6.0, roi_radius=1.0)
    right = mission.WaitForROI(foreground=False, roi_x=9.0, roi_y=6.0, roi_radius=1.0)
    way = mission.GoTo(foreground=False, goal_x=9.0, goal_y=6.0)
    first = mission.wait_for_any_task([left, right])
    mission.wait_for_task(way)
    mission.GoTo(goal_x=1.0, goal_y=6.0)
    mission.wait_for_all_tasks([left, right])
    return "the right one" if first is right else "the left one"
