"""Explore a robot's real handlers: a recovery must end, whatever fails and whenever time runs out.

``tca explore examples/19_explore_recovery.py`` prints the same report. ``legs`` and ``expert`` are
modules that could also run on a robot.
"""

from tca_module import Command, ExceptionHandler, Failure, Module, Task
from tca_tools.explore import (
    Scenario,
    Script,
    at_most_in_all,
    explore,
    failed,
    never,
    never_stuck,
    report,
    retried,
)

LIFT, COLLISION = Command("lift leg", int), Failure("collision", int)
HIGHER: ExceptionHandler[int | None] = ExceptionHandler("lift it higher", int | None)

legs, expert = Module("legs"), Module("expert")


@legs.handles(LIFT)
def lift(_: Task, height: int) -> None:
    if height < 40:
        raise COLLISION(height)


@expert.handles(HIGHER)
def higher(task: Task, height: int | None) -> None:
    trouble = task.trouble
    if height is None or trouble.attempts > 2:  # a timeout has no data
        raise trouble.reissue()
    trouble.failing.retry(LIFT, height + 20)


def lifting(title: str, height: int) -> Scenario:
    """Allow two retries within five seconds."""
    scenario = Scenario(
        title, at_most_in_all(2, retried(LIFT)), never(failed(LIFT, height + 40)), never_stuck()
    )
    scenario.module("legs").handles(LIFT)(lift)
    scenario.module("expert").handles(HIGHER)(higher)

    @scenario.module("user").does
    def lift_a_leg(me: Script) -> None:
        me.on_failure(None, HIGHER, of=LIFT)
        me.command(LIFT, height, deadline=5.0).wait()

    return scenario


LOW, DEEP = lifting("over a stone", 20), lifting("out of a hole", -20)

if __name__ == "__main__":
    for scenario in (LOW, DEEP):
        print(report(explore(scenario)))
