"""A mission that a condition may interrupt."""

from tca_behaviours.missions import ConditionIsCompleted, ConditionVerified, Mission


def interrupted(mission: Mission, goal_x: float = 0.0, goal_y: float = 6.0) -> None:
    """Go to a place. If the turtle enters a region on its way, draw a circle there instead."""
    watch = mission.WaitForROI(foreground=False, roi_x=1.0, roi_y=6.0, roi_radius=1.0)
    mission.add_condition(ConditionIsCompleted(watch, "ROI detector"))
    try:
        mission.Wait(duration=0.2)
        mission.GoTo(goal_x=goal_x, goal_y=goal_y)
        mission.clear_conditions()
        mission.stop_task(watch)
    except ConditionVerified:
        mission.Constant(linear=1.0, angular=1.0, duration=6.3)
