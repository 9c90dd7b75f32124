"""The layer for failed grasps: at most two retries, then the cup is left alone for a while."""

from robots.office_sim.messages import (
    COLLECT_CUP,
    CUP_SLIPPED,
    GRASP,
    LEAVE_ALONE,
    NO_CUP_THERE,
    NO_WAY,
)
from robots.office_sim.program import run
from tca_module import ExceptionHandler, Module, Task

TRIES = 3
"""How often the robot tries to grasp a cup."""

GRASP_AGAIN = ExceptionHandler("grasp again")
GIVE_UP_CUP = ExceptionHandler("give up cup")


def make_module(_: float) -> Module:
    """Make the layer's module."""
    layer = Module("grasps layer")

    @layer.at_start
    def attach(module: Module) -> None:
        module.on_failure(CUP_SLIPPED, GRASP_AGAIN, of=GRASP, maximum=TRIES - 1)
        for failure in (CUP_SLIPPED, NO_CUP_THERE, NO_WAY):
            module.on_failure(failure, GIVE_UP_CUP, of=COLLECT_CUP)

    @layer.handles(GRASP_AGAIN)
    def grasp_again(task: Task) -> None:
        task.trouble.failing.retry()

    @layer.handles(GIVE_UP_CUP)
    def give_up_cup(task: Task) -> None:
        """Kill the goal. If the cup stays in view, a later goal collects it."""
        goal = task.trouble.attached
        assert goal is not None
        task.inform(LEAVE_ALONE, goal.data(COLLECT_CUP).number)
        goal.kill(f"given up for a while: {task.trouble.text}")

    return layer


if __name__ == "__main__":
    run(make_module)
