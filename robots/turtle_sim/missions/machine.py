"""The patrol as a state machine that watches for a region during one part."""

from collections.abc import Iterable

from tca_behaviours.missions import Mission
from tca_behaviours.missions.charts import Sequence

POINTS = ((1.0, 9.0), (9.0, 9.0), (9.0, 1.0))


def machine(points: Iterable[tuple[float, float]] = POINTS) -> Sequence:
    """Patrol the points for ever. A turtle that enters the region goes to the middle at once."""
    with Sequence("patrol") as sm:
        init = sm.Wait(duration=1.0)
        sm.GoTo(goal_x=1.0, goal_y=1.0)
        with sm.concurrence():
            sm.WaitForROI(foreground=False, roi_x=9.0, roi_y=6.0, roi_radius=1.0)
            with sm.sequence():
                for x, y in points:
                    sm.Wait(duration=0.2)
                    sm.GoTo(goal_x=x, goal_y=y)
        sm.GoTo(goal_x=5.0, goal_y=5.0).on(completed=init)
    return sm


if __name__ == "__main__":
    with Mission("turtle") as turtle:
        machine().run(turtle)
