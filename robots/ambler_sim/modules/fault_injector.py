"""The fault injector: causes faults now and then, by a schedule or at random from a seed.

It taps the leg moves. While it holds one of them, it causes the faults of that footstep.
"""

from itertools import count
from random import Random

from robots.ambler_sim.messages import FAULT_BEGAN, FELT, INJECT, LOSE_PROGRAM, MOVE_LEG, STANCE
from robots.ambler_sim.options import walk_options
from robots.ambler_sim.vocabulary import LEGS, Fault, LegMove, Obstacle
from robots.plane import world_place
from tca_module import Command, Condition, Module, Task

RATE = 0.08
"""Faults per footstep, of all kinds together."""

FIRST = 4
"""The first footstep that can have a random fault."""

OPERATOR_SHARE = 0.25
"""The share of amplifier and joint faults that only an operator can reset."""

PROGRAMS = (
    "scanner",
    "mapper",
    "footfall planner",
    "leg recovery planner",
    "body planner",
    "gait planner",
    "error recovery",
    "controller",
)

CENTRAL = "central"
"""The program that the fault "lost central" kills; "lost module" kills one of PROGRAMS."""

MAKE_TROUBLE = Command("make trouble", LegMove)


def random_kinds(kinds: tuple[str, ...], seed: int, number: int) -> tuple[str, ...]:
    """Draw the kinds of faults that come with a footstep: mostly none."""
    random = Random(f"{seed} {number}")  # noqa: S311
    return (random.choice(kinds),) if kinds and number >= FIRST and random.random() < RATE else ()


def make_fault(kind: str, seed: int, number: int) -> Fault:
    """Draw the details of a fault of this kind."""
    random = Random(f"{seed} {number} {kind}")  # noqa: S311
    leg = random.choice(LEGS)
    match kind:
        case "amplifier trip" | "stuck joint":
            return Fault(kind, leg, needs_operator=random.random() < OPERATOR_SHARE)
        case "no image" | "bad image":
            return Fault(kind, size=random.choice((1, 1, 2, 5)))
        case _:
            return Fault(kind, leg)


def make_module(kinds: tuple[str, ...], schedule: list[tuple[str, int]], seed: int) -> Module:
    """Make the injector of random faults of these *kinds*, and of a *schedule* by leg move."""
    injector = Module("fault injector")
    numbers = count(1)

    @injector.at_start
    def attach(module: Module) -> None:
        module.tap(Condition.BEFORE_HANDLING, MOVE_LEG, MAKE_TROUBLE)

    @injector.handles(MAKE_TROUBLE)
    def make_trouble(task: Task, move: LegMove) -> None:
        number = next(numbers)
        due = [kind for kind, at in schedule if at == number]
        for kind in (*due, *random_kinds(kinds, seed, number)):
            program_choice = Random(f"{seed} {number} program")  # noqa: S311
            cause_fault(task, make_fault(kind, seed, number), move, program_choice)

    return injector


def cause_fault(task: Task, fault: Fault, move: LegMove, random: Random) -> None:
    """Make the fault happen."""
    match fault.kind:
        case "lost central":
            task.command(LOSE_PROGRAM, CENTRAL).wait()
        case "lost module":
            task.command(LOSE_PROGRAM, random.choice(PROGRAMS)).wait()
        case "no footfall":
            # An area a metre ahead of this foothold becomes unfit to stand on.
            heading = task.query(STANCE).pose.heading
            x, y = world_place(move.foothold.x, move.foothold.y, heading, 1.0, 0.0)
            task.inform(FELT, Obstacle(x, y, move.foothold.z, 0.75, is_wall=False))
            task.broadcast(FAULT_BEGAN, fault)
        case _:
            task.command(INJECT, fault).wait()


if __name__ == "__main__":
    options = walk_options(".modules.fault_injector", __doc__).parse_args()
    make_module(options.faults, options.fault, options.seed).run()
