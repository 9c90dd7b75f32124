"""The task manager: while the floor is kept free, each new cup becomes a goal."""

from robots.office_sim.messages import (
    ADD_CUP,
    CALL_IT_A_DAY,
    COLLECT_CUP,
    CUPS_IN_VIEW,
    FIND_NEW_CUP,
    KEEP_FLOOR_FREE,
    LEAVE_ALONE,
    NEW_CUPS,
)
from robots.office_sim.program import run
from robots.office_sim.vocabulary import Cup
from tca_module import Module, MonitorRef, Task

PERIOD = 1.0
"""Seconds between two searches for new cups."""

WHILE = 30.0
"""Seconds for which a cup is left alone."""


def make_module(pace: float) -> Module:
    """Make the module."""
    manager = Module("task manager")
    watching: list[MonitorRef[None]] = []
    alone: dict[int, float] = {}

    @manager.handles(KEEP_FLOOR_FREE)
    def keep_floor_free(task: Task) -> None:
        watching.append(task.monitor(NEW_CUPS, period=PERIOD / pace, waited_for=True))

    @manager.handles(FIND_NEW_CUP)
    def find_new_cup(task: Task) -> Cup | None:
        """A cup without a goal. Only the task tree records which cups have goals."""
        known = _cups_with_goals(task) | {
            number for number, until in alone.items() if task.time() < until
        }
        return next((cup for cup in task.query(CUPS_IN_VIEW) if cup.number not in known), None)

    @manager.handles(ADD_CUP)
    def add_cup(task: Task, cup: Cup) -> None:
        """Add a goal for the cup after the present goals."""
        if cup.number not in _cups_with_goals(task):
            task.under(task.monitor_ref).goal(COLLECT_CUP, cup)

    @manager.handles(LEAVE_ALONE)
    def leave_alone(task: Task, number: int) -> None:
        alone[number] = task.time() + WHILE / pace

    @manager.handles(CALL_IT_A_DAY)
    def call_it_a_day(_: Task) -> None:
        while watching:
            watching.pop().end()

    return manager


def _cups_with_goals(task: Task) -> set[int]:
    goals = (goal.info() for goal in task.tasks(COLLECT_CUP))
    return {COLLECT_CUP.decode_data(goal.data).number for goal in goals if goal is not None}


if __name__ == "__main__":
    run(make_module)
