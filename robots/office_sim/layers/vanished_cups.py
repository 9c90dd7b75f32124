"""The layer for vanished cups: a monitor on each goal, which kills it when its cup is out of view.

Somebody else has picked up the cup then. Before the hand closes on it the monitor ends, as from there on the robot
itself is the reason.
"""

from robots.office_sim.messages import COLLECT_CUP, CUPS_IN_VIEW, GRASP
from robots.office_sim.program import run
from robots.office_sim.vocabulary import Cup
from tca_module import Command, Condition, Module, PollingMonitor, Query, Task

PERIOD = 1.0

IS_GONE = Query("is cup gone", Cup, reply=bool)
CANCEL_GOAL = Command("cancel goal", Cup)
CUP_GONE = PollingMonitor("cup gone", Cup, condition=IS_GONE, action=CANCEL_GOAL)
STOP_WATCHING = Command("stop watching")


def make_module(pace: float) -> Module:
    """The module."""
    layer = Module("vanished cups layer")

    @layer.at_start
    def attach(module: Module) -> None:
        module.tap(Condition.WHILE_PLANNING, COLLECT_CUP, CUP_GONE, period=PERIOD / pace, maximum=1)
        module.tap(Condition.BEFORE_HANDLING, GRASP, STOP_WATCHING)

    @layer.handles(IS_GONE)
    def is_gone(task: Task, cup: Cup) -> bool:
        return all(seen.number != cup.number for seen in task.query(CUPS_IN_VIEW))

    @layer.handles(CANCEL_GOAL)
    def cancel_goal(task: Task, cup: Cup) -> None:
        for goal in task.monitor_ref.ancestors(COLLECT_CUP):
            goal.kill(f"cup {cup.number} is out of view: somebody else has picked it up")

    @layer.handles(STOP_WATCHING)
    def stop_watching(task: Task) -> None:
        assert task.tap_event.tapped is not None
        for goal in task.tap_event.tapped.ancestors(COLLECT_CUP):
            for monitor in goal.children(CUP_GONE):
                monitor.kill("the hand is over the cup")

    return layer


if __name__ == "__main__":
    run(make_module)
