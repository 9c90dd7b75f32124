"""The gait planner: turns an arc into steps, planning one step ahead of the one that is walked
(paper, figure 2).

Each "take steps" orders its own moves and then the next "take steps", which is planned while this
one is walked: so step n+1 is planned while step n is walked, and never n+2. Every second step
begins with an image of the ground ahead; the next one is planned when that has been taken.

For comparison it also plans without looking ahead (``--mode sequential``), and ahead, but with a
map that is finished before the legs move (``--mode ahead``).
"""

from dataclasses import replace

from robots.ambler_sim.geometry import distance
from robots.ambler_sim.messages import (
    ACHIEVED_POSITION,
    ACQUIRE_IMAGE,
    MOVE_BODY,
    MOVE_LEG,
    NOT_THERE,
    PLAN_BODY_MOVE,
    PLAN_FOOTFALL,
    PLAN_LEG_RECOVERY,
    POSITION_REACHED,
    STANCE,
    TAKE_STEPS,
    TRAVERSE_ARC,
    UPDATE_MAP,
    Ahead,
    Placing,
    StepEnd,
)
from robots.ambler_sim.options import Mode, walk_options
from robots.ambler_sim.planning.gait import (
    TOLERANCE,
    after_step,
    is_finished,
    next_step,
    rejoin,
    with_foot,
)
from robots.ambler_sim.vocabulary import Arc, Pose, Stance
from tca_module import Constraint, Module, Task, this

CLOSE_ENOUGH = 0.15
"""Metres between where the body is and where it should be after a step."""

STEPS_PER_IMAGE = 2

planner = Module("gait planner")


class GaitMemory:
    """The mode, the number of the next footstep, and the last stances that were measured, by
    footstep: feet creep a little, so these are better than what was foreseen.
    """

    def __init__(self) -> None:
        self.mode = Mode.CONCURRENT
        self.number = 0
        self._measured: dict[int, Stance] = {}

    def note(self, number: int, stance: Stance) -> None:
        """Measured after the footstep with this number."""
        self._measured = {number - 1: self._measured.get(number - 1, stance), number: stance}

    def corrected(self, ahead: Ahead) -> Stance:
        """The foreseen stance with the feet that were measured before the footstep that is walked
        now; not the foot that this one moves.
        """
        foreseen, measured = ahead.stance, self._measured.get(ahead.number - 2)
        if measured is None or foreseen.last_leg < 0:
            return foreseen
        return with_foot(replace(foreseen, feet=measured.feet), foreseen.feet[foreseen.last_leg])


memory = GaitMemory()


@planner.handles(TRAVERSE_ARC)
def traverse_arc(task: Task, course: Arc) -> None:
    """Walk what remains of a piece of the course from where the robot is now."""
    stance = task.query(STANCE)
    if is_finished(course, stance.pose):
        return
    ahead = Ahead(rejoin(course, stance.pose), stance, memory.number)
    with task.sequence():
        image = task.command(ACQUIRE_IMAGE, memory.number)
        if memory.mode is not Mode.CONCURRENT:
            task.command(UPDATE_MAP)
        task.goal(TAKE_STEPS, ahead, constraints=[image.achieving.end <= this.planning.start])


@planner.handles(TAKE_STEPS)
def take_steps(task: Task, ahead: Ahead) -> None:
    """Plan one step and order it; leave the rest of the arc to the next "take steps"."""
    number = memory.number = ahead.number
    step = next_step(memory.corrected(ahead), ahead.arc)
    placing = Placing(step, task.query(PLAN_FOOTFALL, step))
    leg_move = task.query(PLAN_LEG_RECOVERY, placing)
    body_move = task.query(PLAN_BODY_MOVE, placing)
    with task.sequence():
        started: list[Constraint] = [task.achieving.start <= this.planning.start]
        if number % STEPS_PER_IMAGE:
            started = look(task, number)
        task.command(MOVE_LEG, leg_move)
        task.command(MOVE_BODY, body_move)
        achieved = task.monitor(ACHIEVED_POSITION, StepEnd(number, body_move.goal))
        if step.remaining >= TOLERANCE:
            rest = Ahead(ahead.arc, after_step(step, placing.foothold, body_move.goal), number + 1)
            if memory.mode is Mode.SEQUENTIAL:
                started = [achieved.achieving.end <= this.planning.start]
            task.goal(TAKE_STEPS, rest, constraints=started)
        else:
            memory.number = number + 1


def look(task: Task, number: int) -> list[Constraint]:
    """Order an image before the legs move; the next step is planned after it."""
    image = task.command(ACQUIRE_IMAGE, number)
    if memory.mode is not Mode.CONCURRENT:
        image = task.command(UPDATE_MAP)
    return [image.achieving.end <= this.planning.start]


@planner.handles(POSITION_REACHED, resource="position check")
def position_reached(task: Task, reached: StepEnd) -> Pose:
    """Whether the body is where the step should have brought it: where it is, or a failure."""
    stance, goal = task.query(STANCE), reached.goal
    memory.note(reached.number, stance)
    missing = distance(stance.pose, goal)
    if missing > CLOSE_ENOUGH:
        raise NOT_THERE(
            f"{missing:.2f} m",
            f"the body is {missing:.2f} m from where the step should have brought it",
        )
    return stance.pose


if __name__ == "__main__":
    memory.mode = walk_options(".modules.gait_planner", __doc__).parse_args().mode
    planner.run()
