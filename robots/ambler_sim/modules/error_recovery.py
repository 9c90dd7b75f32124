"""Error recovery when a leg meets something, from the leg up to the whole walk (paper, figure 3).

Each rung of the ladder is an exception handler at its own level of the task tree. First the leg
move is retried higher. Then the step is planned again. Then the feet are shuffled into the standard
configuration and the arc is begun again. At last the walk is given up. The modules that plan and
move do not know this one.
"""

from dataclasses import replace

from robots.ambler_sim.errors import AmblerError, PathBlocked
from robots.ambler_sim.messages import (
    ACHIEVED_POSITION,
    ACQUIRE_IMAGE,
    ELEVATION_MAP,
    FELT,
    FORGET_FELT,
    MOVE_BODY,
    MOVE_LEG,
    STANCE,
    TAKE_STEPS,
    TRAVERSE_ARC,
    TRAVERSE_PATH,
    Ahead,
    StepEnd,
)
from robots.ambler_sim.planning.gait import TOLERANCE, after_step
from robots.ambler_sim.planning.replanning import (
    another_step,
    centring_move,
    obstacle_at,
    raised_move,
    shuffle,
    window_around,
)
from robots.ambler_sim.recovery import (
    DO_AGAIN,
    GIVE_UP,
    PLAN_OTHERWISE,
    RAISE_LEG,
    REPLAN_MOVE,
    SHUFFLE_FEET,
    STUCK,
    WALK_GIVEN_UP,
)
from robots.ambler_sim.vocabulary import LEGS, NO_LEG, Contact, ElevationMap, Stance
from tca_module import Module, Scope, Task, TaskRef, Trouble

MOST_REPLANNINGS = 3
"""How often a step is planned again, at most."""

MOST_SHUFFLES = 12
"""How often in one arc the feet are shuffled for a step without an alternative, at most."""

FORGOTTEN_AFTER = 3
"""The number of shuffles after which the obstacles that legs felt are forgotten."""

MOST_ATTEMPTS = 5
"""The number of modules that may die of the same task before the task fails."""

recovery = Module("error recovery")
recovery.resource("steps", capacity=3)
"""While a handler waits for the step before, another handler may have to replace that step."""


@recovery.at_start
def attach(module: Module) -> None:
    """Give up the walk after any other failure. Shuffle the feet where lower rungs are stuck."""
    module.on_failure(None, GIVE_UP, of=TRAVERSE_PATH, maximum=1)
    module.on_failure(STUCK, SHUFFLE_FEET, of=TRAVERSE_ARC, maximum=MOST_SHUFFLES)


@recovery.handles(RAISE_LEG)
def raise_leg(task: Task, contact: Contact) -> None:
    """Retry the leg move higher, from where the foot was put down."""
    leg_move = task.trouble.failing
    try:
        higher = raised_move(leg_move.data(MOVE_LEG), task.query(STANCE), contact)
    except PathBlocked:
        raise task.trouble.reissue() from None
    leg_move.retry(MOVE_LEG, higher)


@recovery.handles(REPLAN_MOVE)
def replan_move(task: Task, contact: Contact) -> None:
    """Put an obstacle or a bad foothold into the map, and take the step another way."""
    stance = task.query(STANCE)
    task.inform(FELT, obstacle_at(contact))
    take_another_step(task, stance, contact.leg)


@recovery.handles(PLAN_OTHERWISE, resource="steps")
def plan_otherwise(task: Task) -> None:
    """Replace a step that can't be planned or walked, once the step before it has been walked."""
    step_task = attachment(task.trouble)
    earlier_step = step_task.parent()
    if earlier_step is not None and earlier_step.message == TAKE_STEPS.name:
        for arrival in earlier_step.children(ACHIEVED_POSITION):
            if not arrival.wait().lets_successors_continue:
                # Another handler recovers the earlier step, and plans all later steps again.
                task.trouble.resolved()
                return
    task.command(ACQUIRE_IMAGE, step_task.data(TAKE_STEPS).number).wait()
    take_another_step(task, task.query(STANCE), NO_LEG)


def take_another_step(task: Task, stance: Stance, leg: int) -> None:
    """Kill the planned step, take it another way, and have the rest of the arc planned again."""
    trouble, step_task = task.trouble, attachment(task.trouble)
    if trouble.invocations > MOST_REPLANNINGS or trouble.failing.ancestors(SHUFFLE_FEET):
        raise STUCK(trouble.text, trouble.text)
    ahead = step_task.data(TAKE_STEPS)
    try:
        other = another_step(ground(task, stance), stance, ahead.arc, leg)
    except AmblerError as error:
        raise STUCK(str(error), f"{trouble.text}; and {error}") from error
    abandon(trouble, "planned again")
    with task.sequence():
        task.command(MOVE_LEG, other.leg_move)
        task.command(MOVE_BODY, other.body_move)
        task.monitor(ACHIEVED_POSITION, StepEnd(ahead.number, other.body_move.goal))
    if other.step.remaining >= TOLERANCE:
        after = after_step(other.step, other.leg_move.foothold, other.body_move.goal)
        step_task.retry(TAKE_STEPS, Ahead(ahead.arc, after, ahead.number + 1))
    else:
        trouble.resolved()


def ground(task: Task, stance: Stance) -> ElevationMap:
    """Return the map of all ground that legs can reach."""
    return task.query(ELEVATION_MAP, window_around(stance))


@recovery.handles(SHUFFLE_FEET)
def shuffle_feet(task: Task) -> None:
    """Move the body to where it stands best and the feet into the standard configuration around it.
    Then begin the rest of the arc from there.
    """
    trouble, stance = task.trouble, task.query(STANCE)
    if trouble.invocations > FORGOTTEN_AFTER:
        task.inform(FORGET_FELT)
    shift = centring_move(stance)
    there = replace(stance, pose=shift.goal) if shift else stance
    moves = shuffle(ground(task, stance), there, _leg_of(trouble.failing))
    abandon(trouble, "begun again")
    with task.sequence():
        if shift:
            task.command(MOVE_BODY, shift)
        for move in moves:
            task.command(MOVE_LEG, move)
    attachment(trouble).retry()


@recovery.handles(DO_AGAIN)
def do_again(task: Task) -> None:
    """Repeat the work that a module had when it died. Moves can safely be repeated, because they
    begin where the robot stands.

    A gait planner that had ordered a part of its plan would order that part twice. In that case the
    rest of the arc is begun again instead.
    """
    trouble, failing = task.trouble, task.trouble.failing
    if trouble.attempts > MOST_ATTEMPTS:
        raise trouble.reissue()
    has_ordered_moves = any(child.id != task.id for child in failing.children())
    if failing.message != TAKE_STEPS.name or not has_ordered_moves:
        failing.retry()
        return
    abandon(trouble, "begun again")
    attachment(trouble).retry()


@recovery.handles(GIVE_UP)
def give_up(task: Task) -> None:
    """End the walk, because no rung helped. The sender of the walk gets the reason."""
    raise WALK_GIVEN_UP(task.trouble.failure, f"{task.trouble.text} ({task.trouble.failure})")


def abandon(trouble: Trouble, why: str) -> None:
    """Kill all planned tasks below the task that this handler is attached to.

    Exception handlers between that task and the failing one survive this kill, with the tasks that
    they sent. Kill those tasks, too.
    """
    rungs = REPLAN_MOVE, PLAN_OTHERWISE, SHUFFLE_FEET
    handlers = [task for rung in rungs for task in trouble.failing.ancestors(rung)]
    for task in (*handlers, attachment(trouble)):
        task.kill(why, scope=Scope.DESCENDANTS)


def attachment(trouble: Trouble) -> TaskRef:
    """Return the task that this rung of the ladder is attached to."""
    assert trouble.attached is not None
    return trouble.attached


def _leg_of(failing: TaskRef) -> int:
    """Return the leg that could not move; leg 0 if the body could not move."""
    moves = [task for task in (failing, *failing.ancestors()) if task.message == MOVE_LEG.name]
    return moves[0].data(MOVE_LEG).leg if moves else LEGS[0]


if __name__ == "__main__":
    recovery.run()
