"""The layer for vanished cups: a monitor on each goal, which kills the goal when its cup is out of
view.

A person has then picked up the cup, unless the robot's own hand holds it.
"""

from robots.office_sim.messages import COLLECT_CUP, CUPS_IN_VIEW, HELD_CUP
from robots.office_sim.program import run
from robots.office_sim.vocabulary import Cup
from tca_module import Command, Condition, Module, PollingMonitor, Query, Task

PERIOD = 1.0
"""Seconds between two checks of a cup."""

IS_GONE = Query("is cup gone", Cup, reply=bool)
CANCEL_GOAL = Command("cancel goal", Cup)
CUP_GONE = PollingMonitor("cup gone", Cup, condition=IS_GONE, action=CANCEL_GOAL)


def make_module(pace: float) -> Module:
    """Make the layer's module."""
    layer = Module("vanished cups layer")

    @layer.at_start
    def attach(module: Module) -> None:
        module.tap(Condition.WHILE_PLANNING, COLLECT_CUP, CUP_GONE, period=PERIOD / pace, maximum=1)

    @layer.handles(IS_GONE)
    def is_gone(task: Task, cup: Cup) -> bool:
        """Whether the cup is out of view and not in the hand; the arm answers only at rest."""
        is_in_view = any(seen.number == cup.number for seen in task.query(CUPS_IN_VIEW))
        return not is_in_view and task.query(HELD_CUP) != cup.number

    @layer.handles(CANCEL_GOAL)
    def cancel_goal(task: Task, cup: Cup) -> None:
        for goal in task.monitor_ref.ancestors(COLLECT_CUP):
            goal.kill(f"cup {cup.number} is out of view: a person has picked it up")

    return layer


if __name__ == "__main__":
    run(make_module)
