"""The machine of the case study: an object is carried to the box at B or, if B is not free, to the
one at C.

Only the arm's move to its box can be done ahead, while the base still drives. The other activities
need facts that do not hold yet. The gripper opens only when the arm has arrived. The arm is tucked
only when the object is released. The base drives back only with a tucked arm.
"""

from robots.youbot_sim.messages import BOX_B_FREE, MOVE_ARM, MOVE_BASE, MOVE_GRIPPER
from robots.youbot_sim.vocabulary import Move
from tca_behaviours.coordination import Activity, Agent, Coordination, Do, Fact, Perceived

GIVEN, ENOUGH = "object given", "enough"
"""The events that the user posts."""

WAITING = "waiting"
"""The state in which the robot waits for an object."""

ARM_COST = 0.3
"""The cost of an arm move in vain. The gain of an early arm move that is needed is 1."""

BASE, ARM, GRIPPER = Agent("base"), Agent("arm"), Agent("gripper")


def make_delivery() -> Coordination:
    """Build the machine of the paper's figure 6."""
    with Coordination("deliver", facts={"base": "A", "arm": "home", "holding": False}) as deliver:
        waiting = deliver.state(WAITING)
        taking = deliver.state(
            "taking", Activity(Do(MOVE_GRIPPER, Move("closed"), GRIPPER), makes={"holding": True})
        )
        to_b = deliver.state("going to B", _drive("B", needs={"holding": True}))
        arm_b = deliver.state("arm to box B", _reach("box B"))
        drop_b = deliver.state("dropping in B", _drop("B"))
        to_c = deliver.state("going to C", _drive("C", needs={"holding": True}))
        arm_c = deliver.state("arm to box C", _reach("box C"))
        drop_c = deliver.state("dropping in C", _drop("C"))
        tuck = deliver.state(
            "tucking",
            Activity(
                Do(MOVE_ARM, Move("tucked"), ARM), needs={"holding": False}, makes={"arm": "tucked"}
            ),
        )
        back = deliver.state("going back", _drive("A", needs={"arm": "tucked"}))
        home = deliver.state(
            "homing",
            Activity(Do(MOVE_ARM, Move("home"), ARM), needs={"base": "A"}, makes={"arm": "home"}),
        )
        end = deliver.final("finished")
        waiting.to(taking, on=GIVEN)
        waiting.to(end, on=ENOUGH)
        taking.to(to_b)
        to_b.to(arm_b, when=BOX_B_FREE, likelihood=Perceived(BOX_B_FREE))
        to_b.to(to_c, likelihood=Perceived(BOX_B_FREE, negated=True))
        arm_b.to(drop_b)
        drop_b.to(tuck)
        to_c.to(arm_c)
        arm_c.to(drop_c)
        drop_c.to(tuck)
        tuck.to(back)
        back.to(home)
        home.to(waiting)
    return deliver


def _drive(place: str, needs: dict[str, Fact]) -> Activity:
    return Activity(Do(MOVE_BASE, Move(place), BASE), needs=needs, makes={"base": place})


def _reach(pose: str) -> Activity:
    return Activity(
        Do(MOVE_ARM, Move(pose), ARM),
        needs={"holding": True},
        makes={"arm": pose},
        cost=ARM_COST,
        adapt=_slowed,
    )


def _drop(place: str) -> Activity:
    needs: dict[str, Fact] = {"base": place, "arm": f"box {place}", "holding": True}
    return Activity(Do(MOVE_GRIPPER, Move("open"), GRIPPER), needs=needs, makes={"holding": False})


def _slowed(move: Move, share: float, _rank: int) -> Move:
    return Move(move.to, share)
