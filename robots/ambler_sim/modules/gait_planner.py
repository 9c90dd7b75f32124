"""The gait planner: turns an arc into steps, planning one step ahead of the walking (paper, figure
2).

Each "take steps" orders its own moves and then the next "take steps", which is planned while the
first is walked. Step n+1 is therefore planned while step n is walked; step n+2 is not. Every second
step begins with an image of the ground ahead; the next step is planned after that image.

Other modes are for comparison. With ``--mode sequential`` each step is planned after the end of the
step before. With ``--mode ahead`` steps are planned ahead, but the map is finished before the legs
move.
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
"""Metres allowed between the body's pose after a step and the planned one."""

STEPS_PER_IMAGE = 2

planner = Module("gait planner")


class GaitMemory:
    """The mode, the number of the next footstep, and the last measured stances by footstep. Feet
    creep a little, so measured stances are better than foreseen ones.
    """

    def __init__(self) -> None:
        self.mode = Mode.CONCURRENT
        self.number = 0
        self._measured: dict[int, Stance] = {}

    def record(self, number: int, stance: Stance) -> None:
        """Store the stance measured after the footstep with this number."""
        self._measured = {number - 1: self._measured.get(number - 1, stance), number: stance}

    def corrected(self, ahead: Ahead) -> Stance:
        """Return the foreseen stance, with the feet as measured before the footstep that is being
        walked. The foot that moves in this footstep stays as foreseen.
        """
        foreseen, measured = ahead.stance, self._measured.get(ahead.number - 2)
        if measured is None or foreseen.last_leg < 0:
            return foreseen
        return with_foot(replace(foreseen, feet=measured.feet), foreseen.feet[foreseen.last_leg])


memory = GaitMemory()


@planner.handles(TRAVERSE_ARC)
def traverse_arc(task: Task, course: Arc) -> None:
    """Walk the rest of a piece of the course from the robot's present place."""
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
    """Plan one step and order it. The rest of the arc goes to the next "take steps"."""
    number = memory.number = ahead.number
    step = next_step(memory.corrected(ahead), ahead.arc)
    placing = Placing(step, task.query(PLAN_FOOTFALL, step))
    leg_move = task.query(PLAN_LEG_RECOVERY, placing)
    body_move = task.query(PLAN_BODY_MOVE, placing)
    with task.sequence():
        next_step_after: list[Constraint] = [task.achieving.start <= this.planning.start]
        if number % STEPS_PER_IMAGE:
            next_step_after = order_image(task, number)
        task.command(MOVE_LEG, leg_move)
        task.command(MOVE_BODY, body_move)
        achieved = task.monitor(ACHIEVED_POSITION, StepEnd(number, body_move.goal))
        if step.remaining >= TOLERANCE:
            rest = Ahead(ahead.arc, after_step(step, placing.foothold, body_move.goal), number + 1)
            if memory.mode is Mode.SEQUENTIAL:
                next_step_after = [achieved.achieving.end <= this.planning.start]
            task.goal(TAKE_STEPS, rest, constraints=next_step_after)
        else:
            memory.number = number + 1


def order_image(task: Task, number: int) -> list[Constraint]:
    """Order an image before the legs move. Returns the constraint on the next step's planning."""
    image = task.command(ACQUIRE_IMAGE, number)
    if memory.mode is not Mode.CONCURRENT:
        image = task.command(UPDATE_MAP)
    return [image.achieving.end <= this.planning.start]


@planner.handles(POSITION_REACHED, resource="position check")
def position_reached(task: Task, planned: StepEnd) -> Pose:
    """Check that the step has brought the body to its goal. Returns the body's pose."""
    stance = task.query(STANCE)
    memory.record(planned.number, stance)
    missing = distance(stance.pose, planned.goal)
    if missing > CLOSE_ENOUGH:
        raise NOT_THERE(
            f"{missing:.2f} m", f"the body is {missing:.2f} m from the planned end of the step"
        )
    return stance.pose


if __name__ == "__main__":
    memory.mode = walk_options(".modules.gait_planner", __doc__).parse_args().mode
    planner.run()
