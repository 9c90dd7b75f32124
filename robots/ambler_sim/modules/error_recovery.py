"""Error recovery: what is done when a leg meets something, from the leg up to the whole walk (paper, figure 3).

Each rung of the ladder is an exception handler where it belongs in the task tree: the leg move is retried higher, the
step is planned anew, the feet are shuffled into the standard configuration and the arc is begun again, and at last the
walk is given up. The modules that plan and move need not know of this one.
"""

from collections import deque

from robots.ambler_sim.errors import AmblerError, PathBlocked
from robots.ambler_sim.messages import (
    ACHIEVED_POSITION,
    ELEVATION_MAP,
    MOVE_BODY,
    MOVE_LEG,
    STANCE,
    TAKE_STEPS,
    TERRAIN_COLLISION,
    TRAVERSE_ARC,
    TRAVERSE_PATH,
    Ahead,
    Bend,
)
from robots.ambler_sim.planning.body import plan_body_move
from robots.ambler_sim.planning.gait import TOLERANCE, after_step, next_step, remaining
from robots.ambler_sim.planning.replanning import Avoided, another_way, felt, raised, shuffle, without
from robots.ambler_sim.reactions import (
    DO_AGAIN,
    GIVE_UP,
    LOST,
    RAISE_LEG,
    REPLAN_MOVE,
    SHUFFLE_FEET,
    STUCK,
    UNSTABLE_FOOTHOLD,
    UNSTABLE_MOVE,
    WALK_GIVEN_UP,
)
from robots.ambler_sim.vocabulary import LEGS, Contact, ElevationMap, Stance
from tca_module import Module, Scope, Task, TaskRef, Trouble

RAISED_AT_MOST, REPLANNED_AT_MOST, SHUFFLED_AT_MOST = 2, 2, 2
"""How often each is tried for one leg move, one step, one arc."""

DONE_AT_MOST = 5
"""How often a handler may die of the same task before that fails."""

MOST_REMEMBERED = 30
"""Places: older ones are behind."""

recovery = Module("error recovery")


@recovery.at_start
def attach(module: Module) -> None:
    """Every leg move, step, arc and path has its rung from now on."""
    module.on_failure(TERRAIN_COLLISION, RAISE_LEG, of=MOVE_LEG, maximum=RAISED_AT_MOST)
    module.on_failure(TERRAIN_COLLISION, REPLAN_MOVE, of=TAKE_STEPS)
    module.on_failure(UNSTABLE_FOOTHOLD, REPLAN_MOVE, of=TAKE_STEPS)
    module.on_failure(STUCK, SHUFFLE_FEET, of=TRAVERSE_ARC, maximum=SHUFFLED_AT_MOST)
    module.on_failure(UNSTABLE_MOVE, SHUFFLE_FEET, of=TRAVERSE_ARC, maximum=SHUFFLED_AT_MOST)
    module.on_failure(LOST, DO_AGAIN, of=TRAVERSE_ARC)
    module.on_failure(None, GIVE_UP, of=TRAVERSE_PATH, maximum=1)


class ObstacleMemory:
    """The obstacles that legs have met so far: the scanner did not see them."""

    def __init__(self) -> None:
        self.avoided: deque[Avoided] = deque(maxlen=MOST_REMEMBERED)

    def ground(self, task: Task, stance: Stance) -> ElevationMap:
        """The map, with what is not to be seen in it."""
        return without(task.query(ELEVATION_MAP, stance), self.avoided)


memory = ObstacleMemory()


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
    """Forget what was planned of the step, take it another way, and let the rest of the arc be planned anew."""
    trouble, stance = task.trouble, task.query(STANCE)
    step_task = trouble.attached
    assert step_task is not None
    memory.avoided.append(felt(contact, stance.feet[contact.leg]))
    if trouble.invocations > REPLANNED_AT_MOST or trouble.failing.ancestors(SHUFFLE_FEET):
        raise STUCK(trouble.text, trouble.text)
    arc = step_task.data(TAKE_STEPS).arc
    try:
        step = next_step(stance, arc, contact.leg)
        leg_move = another_way(memory.ground(task, stance), step)
        body_move = plan_body_move(step, leg_move.foothold)
    except AmblerError as error:
        raise STUCK(str(error), f"{trouble.text}; and {error}") from error
    _abandon(trouble, "planned anew")
    with task.sequence():
        task.command(MOVE_LEG, leg_move)
        task.command(MOVE_BODY, body_move)
        task.monitor(ACHIEVED_POSITION, body_move.goal)
    if step.remaining >= TOLERANCE:
        step_task.retry(TAKE_STEPS, Ahead(arc, after_step(step, leg_move.foothold, body_move.goal)))


@recovery.handles(SHUFFLE_FEET)
def shuffle_feet(task: Task) -> None:
    """Bring the feet into the standard configuration, and begin the rest of the arc from there."""
    trouble, stance = task.trouble, task.query(STANCE)
    arc_task = trouble.attached
    assert arc_task is not None
    arc = _nearest_step(trouble.failing).data(TAKE_STEPS).arc
    rest = remaining(arc, stance.pose)
    moves = shuffle(memory.ground(task, stance), stance, _leg_of(trouble.failing))
    _abandon(trouble, "begun again")
    with task.sequence():
        for move in moves:
            task.command(MOVE_LEG, move)
    if rest >= TOLERANCE:
        arc_task.retry(TRAVERSE_ARC, Bend(arc.curvature, rest))


@recovery.handles(DO_AGAIN)
def do_again(task: Task) -> None:
    """A module died: have done again what it had in hand. Moves begin where the robot stands, so they may come twice.

    A planner that had ordered a part of what it planned would order that again: then the rest of the arc begins anew.
    """
    trouble = task.trouble
    arc_task, failing = trouble.attached, trouble.failing
    assert arc_task is not None
    if trouble.attempts > DONE_AT_MOST:
        raise trouble.reissue()
    has_ordered = any(child.id != task.id for child in failing.children())
    if failing.message != TAKE_STEPS.name or not has_ordered:
        failing.retry()
        return
    _abandon(trouble, "begun again")
    arc = failing.data(TAKE_STEPS).arc
    rest = remaining(arc, task.query(STANCE).pose)
    if rest >= TOLERANCE:
        arc_task.retry(TRAVERSE_ARC, Bend(arc.curvature, rest))


@recovery.handles(GIVE_UP)
def give_up(task: Task) -> None:
    """Nothing helped: the walk ends, and who ordered it is told why."""
    raise WALK_GIVEN_UP(task.trouble.failure, f"{task.trouble.text} ({task.trouble.failure})")


def _abandon(trouble: Trouble, why: str) -> None:
    """Kill all that was to be done under the task that the exception handler is attached to. Other exception handlers
    on the way there outlive that, and what they have sent: it is killed, too.
    """
    assert trouble.attached is not None
    for task in (*trouble.failing.ancestors(REPLAN_MOVE), *trouble.failing.ancestors(SHUFFLE_FEET), trouble.attached):
        task.kill(why, scope=Scope.DESCENDANTS)


def _nearest_step(failing: TaskRef) -> TaskRef:
    return failing.ancestors(TAKE_STEPS)[0]


def _leg_of(failing: TaskRef) -> int:
    """The leg that could not move; any, if it was the body."""
    moves = [task for task in (failing, *failing.ancestors()) if task.message == MOVE_LEG.name]
    return moves[0].data(MOVE_LEG).leg if moves else LEGS[0]


if __name__ == "__main__":
    recovery.run()
