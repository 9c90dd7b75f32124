"""The fault injector: makes something go wrong now and then, by a schedule or at random from a seed.

It taps the leg moves, and while it holds one it sees to the fault that is due with that footstep.
"""

import argparse
from itertools import count
from random import Random

from robots.ambler_sim.geometry import offset
from robots.ambler_sim.messages import FAULT_BEGAN, FELT, INJECT, LOSE_PROGRAM, MOVE_LEG, STANCE
from robots.ambler_sim.vocabulary import KINDS, LEGS, Fault, LegMove, Obstacle
from tca_module import Command, Condition, Module, Task

RATE = 0.08
"""Faults a footstep, of all kinds together."""

FIRST = 4
"""The first footstep with a fault at random."""

OPERATOR_SHARE = 0.25
"""Of the faults of amplifiers and joints: those that only an operator can reset."""

PROGRAMS = (
    "scanner", "mapper", "footfall planner", "leg recovery planner", "body planner", "gait planner", "error recovery",
    "controller",
)  # fmt: skip

CENTRAL = "central"
"""The program that only "lost central" loses."""

MAKE_TROUBLE = Command("make trouble", LegMove)


def drawn(kinds: tuple[str, ...], seed: int, number: int) -> tuple[str, ...]:
    """The kinds of faults that come with a footstep: mostly none."""
    random = Random(f"{seed} {number}")  # noqa: S311
    return (random.choice(kinds),) if kinds and number >= FIRST and random.random() < RATE else ()


def make_fault(kind: str, seed: int, number: int) -> Fault:
    """What exactly happens."""
    random = Random(f"{seed} {number} {kind}")  # noqa: S311
    leg = random.choice(LEGS)
    match kind:
        case "amplifier trip" | "stuck joint":
            return Fault(kind, leg, needs_operator=random.random() < OPERATOR_SHARE)
        case "no image" | "bad image":
            return Fault(kind, size=random.choice((1, 1, 2, 5)))
        case _:
            return Fault(kind, leg)


def make_module(kinds: tuple[str, ...], schedule: dict[int, list[str]], seed: int) -> Module:
    """Faults of these *kinds* at random, and those of the *schedule*, by the number of the leg move (1, 2, ...)."""
    injector = Module("fault injector")
    numbers = count(1)

    @injector.at_start
    def attach(module: Module) -> None:
        module.tap(Condition.BEFORE_HANDLING, MOVE_LEG, MAKE_TROUBLE)

    @injector.handles(MAKE_TROUBLE)
    def make_trouble(task: Task, move: LegMove) -> None:
        number = next(numbers)
        for kind in (*schedule.get(number, ()), *drawn(kinds, seed, number)):
            cause(task, make_fault(kind, seed, number), move, Random(f"{seed} {number} program"))  # noqa: S311

    return injector


def cause(task: Task, fault: Fault, move: LegMove, random: Random) -> None:
    """Have it happen."""
    match fault.kind:
        case "lost central":
            task.command(LOSE_PROGRAM, CENTRAL).wait()
        case "lost module":
            task.command(LOSE_PROGRAM, random.choice(PROGRAMS)).wait()
        case "no footfall":
            heading = task.query(STANCE).pose
            x, y = offset(heading, 1.0, 0.0)
            at_x, at_y = move.foothold.x + x - heading.x, move.foothold.y + y - heading.y
            task.inform(FELT, Obstacle(at_x, at_y, move.foothold.z, 0.75, is_wall=False))
            task.broadcast(FAULT_BEGAN, fault)
        case _:
            task.command(INJECT, fault).wait()


def scheduled(texts: list[str]) -> dict[int, list[str]]:
    """From "KIND@NUMBER". Raises ValueError for anything else."""
    schedule: dict[int, list[str]] = {}
    for text in texts:
        kind, _, number = text.partition("@")
        if kind not in KINDS or not number.isdecimal():
            raise ValueError(f"{text!r} is no fault: give KIND@STEP, with a kind of {', '.join(KINDS)}")
        schedule.setdefault(int(number), []).append(kind)
    return schedule


def fault_at(text: str) -> str:
    """The type of an option that is a fault of a schedule."""
    try:
        scheduled([text])
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return text


def kinds_of(text: str) -> tuple[str, ...]:
    """From "all" or a list with commas. Raises ValueError for a kind that there is not."""
    kinds = KINDS if text == "all" else tuple(filter(None, text.split(",")))
    if wrong := [kind for kind in kinds if kind not in KINDS]:
        raise ValueError(f"there are no faults of kind {wrong[0]!r}: there are {', '.join(KINDS)}")
    return kinds


def fault_options() -> argparse.ArgumentParser:
    """What can be said of faults."""
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument("--faults", type=kinds_of, default=(), metavar="all|KIND,...",
                        help=f"what goes wrong at random: {', '.join(KINDS)}")  # fmt: skip
    parser.add_argument("--fault", type=fault_at, action="append", default=[], metavar="KIND@STEP",
                        help="one fault with that leg move (1, 2, ...); may be repeated")  # fmt: skip
    return parser


def main() -> None:
    """The command line."""
    name = "python -m robots.ambler_sim.modules.fault_injector"
    parser = argparse.ArgumentParser(prog=name, description=__doc__, parents=[fault_options()])
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    make_module(options.faults, scheduled(options.fault), options.seed).run()


if __name__ == "__main__":
    main()
