"""The controller: drives the base, moves the arm, charges."""

from robots.office_sim.messages import (
    CHARGE,
    CLOSE_FINGERS,
    CUP_SLIPPED,
    DOCK,
    DRIVE,
    DROP,
    FOLLOW_PATH,
    GRASP,
    HALT,
    HELD_CUP,
    LET_GO,
    NO_CUP_THERE,
    NOT_AT_CHARGER,
    OPEN_FINGERS,
    STUCK,
)
from robots.office_sim.program import run
from robots.office_sim.vocabulary import Cup, Grasped, Spot
from tca_module import Module, Task

GRASPING, DROPPING = 2.0, 1.0
"""Seconds that the arm needs."""

SETTLING = 0.05
"""Seconds that the base gets in addition to the computed duration of its way."""

TOLERANCE = 0.02
"""The allowed position error (m) of the base."""


class Hand:
    """The hand, and the number of the cup that it holds."""

    def __init__(self, pace: float) -> None:
        self._pace = pace
        self.held: int | None = None

    def grasp(self, task: Task, cup: Cup) -> None:
        """Grasp a cup. Raises CUP_SLIPPED and NO_CUP_THERE."""
        task.sleep(GRASPING / self._pace)
        with task.shielded():  # a kill between closing and recording would lose the cup
            closed = task.query(CLOSE_FINGERS, cup.spot)
            if closed is Grasped.CUP:
                self.held = cup.number
        if closed is Grasped.SLIPPED:
            raise CUP_SLIPPED(cup, f"cup {cup.number} has slipped out of the fingers")
        if closed is Grasped.NOTHING:
            raise NO_CUP_THERE(cup, f"the fingers feel no cup {cup.number}")

    def drop(self, task: Task) -> None:
        """Let go of the cup in the hand."""
        task.sleep(DROPPING / self._pace)
        self.let_go(task, self.held)

    def let_go(self, task: Task, number: int | None) -> None:
        """Let go at once, if the hand holds the cup with this number."""
        if self.held == number:
            with task.shielded():
                task.query(OPEN_FINGERS)
                self.held = None


def make_module(pace: float) -> Module:
    """Make the module. Base and arm have a resource each."""
    controller, hand = Module("controller"), Hand(pace)
    controller.resource("base")
    controller.resource("arm")
    controller.handles(FOLLOW_PATH, resource="base")(follow_path)
    controller.handles(CHARGE, resource="base")(charge)
    controller.handles(GRASP, resource="arm")(hand.grasp)
    controller.handles(DROP, resource="arm")(hand.drop)
    controller.handles(LET_GO, resource="arm")(hand.let_go)
    controller.handles(HELD_CUP, resource="arm")(lambda _: hand.held)
    return controller


def follow_path(task: Task, way: list[Spot]) -> None:
    """Drive from one point to the next. Raises STUCK."""
    if not way:
        return
    try:
        task.sleep(task.query(DRIVE, way) + SETTLING)
    finally:
        with task.shielded():  # a killed task, too, leaves the base at rest
            missing = task.query(HALT).to(way[-1])
    if missing > TOLERANCE:
        raise STUCK(missing, f"the robot stands {missing:.2f} m from where it should be")


def charge(task: Task) -> None:
    """Charge the battery. Raises NOT_AT_CHARGER."""
    seconds = task.query(DOCK)
    if seconds is None:
        raise NOT_AT_CHARGER(None, "the charger is out of reach")
    task.sleep(seconds)


if __name__ == "__main__":
    run(make_module)
