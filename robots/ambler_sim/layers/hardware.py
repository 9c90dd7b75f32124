"""The layer for hardware faults: amplifiers that trip, joints that do not follow, encoders that
drift.

What the robot cannot mend itself an operator does, as on the real machine; that is counted by "call
operator".
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
"""Metres that the two encoders of a leg may differ."""

SWITCH_ON = ExceptionHandler("switch on", int)
FREE = ExceptionHandler("free leg", MotionError)
CALL_OPERATOR = ExceptionHandler("call operator", int)
ENCODER_CHECK = Command("encoder check")

layer = make_layer("hardware")


@layer.at_start
def attach(module: Module) -> None:
    """Watch over the machine."""
    module.tap(Condition.BEFORE_HANDLING, MOVE_LEG, ENCODER_CHECK)
    for move in (MOVE_LEG, MOVE_BODY):
        module.on_failure(AMPLIFIER_TRIPPED, SWITCH_ON, of=move, maximum=3)
        module.on_failure(JOINT_FAULT, FREE, of=move, maximum=3)
    for care in (RESET, FREE_JOINT):
        module.on_failure(NEEDS_OPERATOR, CALL_OPERATOR, of=care, maximum=1)


@layer.handles(SWITCH_ON)
def switch_on(task: Task, leg: int) -> None:
    """Reset the amplifier, and let the move begin again."""
    task.command(RESET, Reset(leg)).wait()
    task.trouble.failing.retry()


@layer.handles(FREE)
def free(task: Task, error: MotionError) -> None:
    """Free the joint, and let the move begin again from where the leg then stands."""
    task.command(FREE_JOINT, Reset(error.leg)).wait()
    task.trouble.failing.retry()


@layer.handles(CALL_OPERATOR, resource="operator")
def call_operator(task: Task, leg: int) -> None:
    """Somebody goes there and does it."""
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
