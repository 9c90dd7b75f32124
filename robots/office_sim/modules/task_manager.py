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

LEFT_ALONE_FOR = 30.0
"""Seconds for which a cup is left alone."""


def make_module(pace: float) -> Module:
    """Make the module."""
    manager = Module("task manager")
    searches: list[MonitorRef[None]] = []
    left_alone_until: dict[int, float] = {}

    @manager.handles(KEEP_FLOOR_FREE)
    def keep_floor_free(task: Task) -> None:
        searches.append(task.monitor(NEW_CUPS, period=PERIOD / pace, waited_for=True))

    @manager.handles(FIND_NEW_CUP)
    def find_new_cup(task: Task) -> Cup | None:
        """Return a cup without a goal. Only the task tree records which cups have goals."""
        ignored, now = _cups_with_goals(task), task.time()
        ignored |= {number for number, until in left_alone_until.items() if now < until}
        return next((cup for cup in task.query(CUPS_IN_VIEW) if cup.number not in ignored), None)

    @manager.handles(ADD_CUP)
    def add_cup(task: Task, cup: Cup) -> None:
        """Add a goal for the cup after the present goals."""
        if cup.number not in _cups_with_goals(task):
            task.under(task.monitor_ref).goal(COLLECT_CUP, cup)

    @manager.handles(LEAVE_ALONE)
    def leave_alone(task: Task, number: int) -> None:
        left_alone_until[number] = task.time() + LEFT_ALONE_FOR / pace

    @manager.handles(CALL_IT_A_DAY)
    def call_it_a_day(_: Task) -> None:
        while searches:
            searches.pop().end()

    return manager


def _cups_with_goals(task: Task) -> set[int]:
    goals = (goal.info() for goal in task.tasks(COLLECT_CUP))
    return {COLLECT_CUP.decode_data(goal.data).number for goal in goals if goal is not None}


if __name__ == "__main__":
    run(make_module)
