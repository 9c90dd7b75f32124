"""A delivery with each program as a process: starts central and the robot's modules, gives the
object, and reads the journal.
"""

from dataclasses import dataclass, field
from pathlib import Path

from robots.youbot_sim.messages import CARRY_OBJECTS, LOOK, MEASURE, MOVE_GRIPPER, OFFER_OBJECT
from robots.youbot_sim.moving import MOVES
from robots.youbot_sim.outcome import CarriedObject, read_delivery
from robots.youbot_sim.robot import Backend, make_robot
from robots.youbot_sim.simulator import Lid
from robots.youbot_sim.vocabulary import GROUPS, JointReadings
from tca_module import Client, connect
from tca_tools.journal.journals import open_log
from tca_tools.supervise.programs import START_TIME, Programs, central_in


@dataclass(frozen=True, slots=True)
class ShownDelivery:
    """A delivery of figure 7: the lid of box B, and whether the coordinator has a preview."""

    title: str
    lid: Lid = field(default_factory=Lid)
    has_preview: bool = True


SCHEDULES = {
    "best": ShownDelivery("with a preview, box B free"),
    "changed": ShownDelivery("with a preview, box B free, then covered on the way", Lid((2.0,))),
    "plain": ShownDelivery(
        "without a preview, box B covered", Lid(starts_covered=True), has_preview=False
    ),
}


def show(delivery: ShownDelivery, folder: Path, backend: Backend) -> tuple[CarriedObject, Path]:
    """Run the delivery, and replace the files of an earlier one. Returns the outcome, and a picture
    of the robot over the box.
    """
    simulator = ["--backend", backend, *(["--covered"] * delivery.lid.starts_covered)]
    for change in delivery.lid.changes:
        simulator += ["--change", str(change)]
    with central_in(folder) as (address, programs):
        programs.start_module("simulator", "robots.youbot_sim.simulator", *simulator)
        for group in GROUPS:
            programs.start_module(group, "robots.youbot_sim.moving", group)
        programs.start_module("perception", "robots.youbot_sim.perception")
        plain = [] if delivery.has_preview else ["--plain"]
        programs.start_module("coordinator", "robots.youbot_sim.coordination", *plain)
        programs.start_module("user", "robots.youbot_sim.user")
        with connect("show", address, START_TIME) as client:
            seen = _watch(client, programs)
    robot = make_robot(backend)
    robot.assume(seen)
    robot.cover(is_covered=delivery.lid != Lid())
    picture = robot.picture(folder / "robot")
    robot.close()
    return read_delivery(open_log(folder / "journal")), picture


def _watch(client: Client, programs: Programs) -> JointReadings:
    """Have an object carried. Returns the robot's joints at the time when the fingers open."""
    programs.wait_until_handled(client, CARRY_OBJECTS, OFFER_OBJECT, LOOK, *MOVES.values())
    seen: JointReadings | None = None
    with client.observe(MOVE_GRIPPER, states=["running"]) as moves:
        carrying = client.command(CARRY_OBJECTS, 1)
        for _ in programs.watch(carrying):
            if any(move.goal.to == "open" for move in moves.arrived()) and seen is None:
                seen = client.query(MEASURE)
        carrying.result()
    assert seen is not None, "the object is in a box"
    return seen
