"""Error recovery: what is done when a leg meets something, from the leg up to the whole walk
(paper, figure 3).

Each rung of the ladder is an exception handler where it belongs in the task tree: the leg move is
retried higher, the step is planned anew, the feet are shuffled into the standard configuration and
the arc is begun again, and at last the walk is given up. The modules that plan and move need not
know of this one.
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
    centring,
    felt,
    raised,
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

REPLANNED_AT_MOST = 3
"""How often for one step."""

SHUFFLED_AT_MOST = 12
"""How often in one arc, for steps of which no other one could be found."""

FORGOTTEN_AFTER = 3
"""Shuffles, after which it is believed no more what legs have felt."""

DONE_AT_MOST = 5
"""How often a handler may die of the same task before that fails."""

recovery = Module("error recovery")
recovery.resource("steps", capacity=3)
"""For what waits until the step before has been walked: meanwhile that may need to be taken
otherwise, too.
"""


@recovery.at_start
def attach(module: Module) -> None:
    """What nobody else handles ends the walk, with a reason; but where the rungs below are stuck,
    feet are shuffled.
    """
    module.on_failure(None, GIVE_UP, of=TRAVERSE_PATH, maximum=1)
    module.on_failure(STUCK, SHUFFLE_FEET, of=TRAVERSE_ARC, maximum=SHUFFLED_AT_MOST)


@recovery.handles(RAISE_LEG)
def raise_leg(task: Task, contact: Contact) -> None:
    """Let the leg try again from where it was put down, higher."""
    leg_move = task.trouble.failing
    try:
        higher = raised(leg_move.data(MOVE_LEG), task.query(STANCE), contact)
    except PathBlocked:
        raise task.trouble.reissue() from None
    leg_move.retry(MOVE_LEG, higher)


@recovery.handles(REPLAN_MOVE)
def replan_move(task: Task, contact: Contact) -> None:
    """A foot met something, or stands badly: put that into the map, and take the step another
    way.
    """
    stance = task.query(STANCE)
    task.inform(FELT, felt(contact))
    take_another_step(task, stance, contact.leg)


@recovery.handles(PLAN_OTHERWISE, resource="steps")
def plan_otherwise(task: Task) -> None:
    """A step can't be planned or walked as planned: once the one before it has been walked, take
    another one.
    """
    step_task = attached(task.trouble)
    before = step_task.parent()
    if before is not None and before.message == TAKE_STEPS.name:
        for moved in before.children(ACHIEVED_POSITION):
            if not moved.wait().lets_successors_continue:
                task.trouble.resolved()  # its own recovery has begun, and will plan all that follows anew
                return
    task.command(ACQUIRE_IMAGE, step_task.data(TAKE_STEPS).number).wait()
    take_another_step(task, task.query(STANCE), NO_LEG)


def take_another_step(task: Task, stance: Stance, leg: int) -> None:
    """Forget what was planned of a step, take it another way, and let the rest of the arc be
    planned anew.
    """
    trouble, step_task = task.trouble, attached(task.trouble)
    if trouble.invocations > REPLANNED_AT_MOST or trouble.failing.ancestors(SHUFFLE_FEET):
        raise STUCK(trouble.text, trouble.text)
    ahead = step_task.data(TAKE_STEPS)
    try:
        other = another_step(ground(task, stance), stance, ahead.arc, leg)
    except AmblerError as error:
        raise STUCK(str(error), f"{trouble.text}; and {error}") from error
    abandon(trouble, "planned anew")
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
    """All ground that legs can reach."""
    return task.query(ELEVATION_MAP, window_around(stance))


@recovery.handles(SHUFFLE_FEET)
def shuffle_feet(task: Task) -> None:
    """Bring the body to where it stands best, and the feet into the standard configuration around
    it; begin the rest of the arc from there.
    """
    trouble, stance = task.trouble, task.query(STANCE)
    if trouble.invocations > FORGOTTEN_AFTER:
        task.inform(FORGET_FELT)
    shift = centring(stance)
    there = replace(stance, pose=shift.goal) if shift else stance
    moves = shuffle(ground(task, stance), there, _leg_of(trouble.failing))
    abandon(trouble, "begun again")
    with task.sequence():
        if shift:
            task.command(MOVE_BODY, shift)
        for move in moves:
            task.command(MOVE_LEG, move)
    attached(trouble).retry()


@recovery.handles(DO_AGAIN)
def do_again(task: Task) -> None:
    """A module died: have done again what it had in hand. Moves begin where the robot stands, so
    they may come twice.

    A planner that had ordered a part of what it planned would order that again: then the rest of
    the arc begins anew.
    """
    trouble, failing = task.trouble, task.trouble.failing
    if trouble.attempts > DONE_AT_MOST:
        raise trouble.reissue()
    has_ordered = any(child.id != task.id for child in failing.children())
    if failing.message != TAKE_STEPS.name or not has_ordered:
        failing.retry()
        return
    abandon(trouble, "begun again")
    attached(trouble).retry()


@recovery.handles(GIVE_UP)
def give_up(task: Task) -> None:
    """Nothing helped: the walk ends, and who ordered it is told why."""
    raise WALK_GIVEN_UP(task.trouble.failure, f"{task.trouble.text} ({task.trouble.failure})")


def abandon(trouble: Trouble, why: str) -> None:
    """Kill all that was to be done under the task that the exception handler is attached to. Other
    exception handlers on the way there outlive that, and what they have sent: it is killed, too.
    """
    rungs = REPLAN_MOVE, PLAN_OTHERWISE, SHUFFLE_FEET
    handlers = [task for rung in rungs for task in trouble.failing.ancestors(rung)]
    for task in (*handlers, attached(trouble)):
        task.kill(why, scope=Scope.DESCENDANTS)


def attached(trouble: Trouble) -> TaskRef:
    """The task that this rung of the ladder is attached to."""
    assert trouble.attached is not None
    return trouble.attached


def _leg_of(failing: TaskRef) -> int:
    """The leg that could not move; any, if it was the body."""
    moves = [task for task in (failing, *failing.ancestors()) if task.message == MOVE_LEG.name]
    return moves[0].data(MOVE_LEG).leg if moves else LEGS[0]


if __name__ == "__main__":
    recovery.run()
