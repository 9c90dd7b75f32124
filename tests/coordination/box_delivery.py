"""A machine that brings an object to box B, or to C if B is occupied."""

from tca_behaviours.coordination import (
    Activity,
    Agent,
    Coordination,
    Do,
    Fact,
    Perceived,
    Situation,
)
from tca_module import Command, Variable

MOVE_BASE = Command("move base", str, progress=float)
MOVE_ARM = Command("move arm", str, progress=float)
MOVE_GRIPPER = Command("move gripper", str)
BOX_B_FREE = Variable("box B is free", float)
BASE, ARM, GRIPPER = Agent("base"), Agent("arm"), Agent("gripper")
START: dict[str, Fact] = {"base": "A", "arm": "home", "holding": True}


def base(place: str) -> Activity:
    return Activity(Do(MOVE_BASE, place, BASE), makes={"base": place}, cost=1.0)


def arm(pose: str, *, can_undo: bool = False) -> Activity:
    undo = Do(MOVE_ARM, "home", ARM) if can_undo else ()
    return Activity(Do(MOVE_ARM, pose, ARM), makes={"arm": pose}, cost=0.2, undo=undo)


def drop(place: str) -> Activity:
    return Activity(
        Do(MOVE_GRIPPER, "open", GRIPPER),
        needs={"arm": place, "base": place},
        makes={"holding": False},
        cost=5.0,
    )


with Coordination("deliver", facts=START) as DELIVER:
    waiting = DELIVER.state("waiting")
    to_b = DELIVER.state("going to B", base("B"))
    with DELIVER.compound("at B") as at_b:
        arm_b = DELIVER.state("arm to B", arm("B"))
        drop_b = DELIVER.state("dropping at B", drop("B"))
        drop_b_done = DELIVER.final("dropped at B")
        arm_b.to(drop_b)
        drop_b.to(drop_b_done)
    to_c = DELIVER.state("going to C", base("C"))
    arm_c = DELIVER.state("arm to C", arm("C"))
    drop_c = DELIVER.state("dropping at C", drop("C"))
    tuck = DELIVER.state("tucking", arm("tucked"))
    to_a = DELIVER.state("going to A", base("A"))
    home = DELIVER.state("homing", arm("home"))
    waiting.to(to_b, on="object given")
    to_b.to(at_b, when=BOX_B_FREE, likelihood=Perceived(BOX_B_FREE))
    to_b.to(to_c, likelihood=Perceived(BOX_B_FREE, negated=True))
    at_b.to(tuck)
    to_c.to(arm_c)
    arm_c.to(drop_c)
    drop_c.to(tuck)
    tuck.to(to_a)
    to_a.to(home)
    home.to(waiting)

LABELS = [state.label for state in DELIVER.states]


def number(label: str) -> int:
    return LABELS.index(label)


def situation(free: float | None = 1.0, progress: float = 0.0) -> Situation:
    return Situation("", START, {BOX_B_FREE.name: free}, progress)
