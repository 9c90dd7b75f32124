"""The hardware layer: tripped amplifiers, joints that do not follow, encoders that drift.

An operator repairs what the robot cannot repair itself, as on the real machine. The task "call
operator" counts these cases.
"""

from robots.ambler_sim.messages import (
    AMPLIFIER_TRIPPED,
    CALIBRATE,
    FREE_JOINT,
    JOINT_FAULT,
    MOVE_BODY,
    MOVE_LEG,
    NEEDS_OPERATOR,
    READINGS,
    RESET,
    MotionError,
    Reset,
)
from robots.ambler_sim.recovery import make_layer
from tca_module import Command, Condition, ExceptionHandler, Module, Task

MOST_DRIFT = 0.03
"""The greatest difference (m) allowed between the two encoders of a leg."""

SWITCH_ON = ExceptionHandler("switch on", int)
FREE = ExceptionHandler("free leg", MotionError)
CALL_OPERATOR = ExceptionHandler("call operator", int)
ENCODER_CHECK = Command("encoder check")

layer = make_layer("hardware")


@layer.at_start
def attach(module: Module) -> None:
    """Attach the repairs to the moves."""
    module.tap(Condition.BEFORE_HANDLING, MOVE_LEG, ENCODER_CHECK)
    for move in (MOVE_LEG, MOVE_BODY):
        module.on_failure(AMPLIFIER_TRIPPED, SWITCH_ON, of=move, maximum=3)
        module.on_failure(JOINT_FAULT, FREE, of=move, maximum=3)
    for repair in (RESET, FREE_JOINT):
        module.on_failure(NEEDS_OPERATOR, CALL_OPERATOR, of=repair, maximum=1)


@layer.handles(SWITCH_ON)
def switch_on(task: Task, leg: int) -> None:
    """Reset the amplifier and retry the move."""
    task.command(RESET, Reset(leg)).wait()
    task.trouble.failing.retry()


@layer.handles(FREE)
def free(task: Task, error: MotionError) -> None:
    """Free the joint and retry the move from the leg's present place."""
    task.command(FREE_JOINT, Reset(error.leg)).wait()
    task.trouble.failing.retry()


@layer.handles(CALL_OPERATOR, resource="operator")
def call_operator(task: Task, leg: int) -> None:
    """Retry the repair with an operator."""
    failing = task.trouble.failing
    failing.retry(RESET if failing.message == RESET.name else FREE_JOINT, Reset(leg, operator=True))


@layer.handles(ENCODER_CHECK)
def encoder_check(task: Task) -> None:
    """Hold a leg move until the encoders agree."""
    for leg, drift in enumerate(task.query(READINGS).encoder_offsets):
        if abs(drift) > MOST_DRIFT:
            task.command(CALIBRATE, leg).wait()


if __name__ == "__main__":
    layer.run()
