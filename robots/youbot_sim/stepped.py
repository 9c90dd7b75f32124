"""The whole robot in one process, on a clock that is stepped: the same delivery comes out the same every time."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from robots.youbot_sim import coordination, perception, simulator, user
from robots.youbot_sim.kinematic import KinematicManipulator
from robots.youbot_sim.messages import CARRY_OBJECTS, MOVE_ARM, MOVE_BASE, MOVE_GRIPPER
from robots.youbot_sim.moving import make_module
from robots.youbot_sim.simulator import Lid, SimulatedRobot
from tca_behaviours.coordination import Coordinator
from tca_module import connect
from tca_module.testing import LocalCentral

SETTLED = 1.0
"""Seconds that perception has to look around before an object is given."""

STRIDE = 1.0


@contextmanager
def robot(lid: Lid, coordinator: Coordinator) -> Iterator[LocalCentral]:
    """All modules, with the kinematic twin; the caller steps its clock."""
    modules = [
        simulator.make_module(SimulatedRobot(KinematicManipulator(), lid), has_steps=False),
        make_module("base", MOVE_BASE),
        make_module("arm", MOVE_ARM),
        make_module("gripper", MOVE_GRIPPER),
        perception.make_module(),
        coordination.make_module(coordinator),
        user.make_module(coordinator),
    ]
    with ExitStack() as stack:
        central = stack.enter_context(LocalCentral(stepped=True))
        for module in modules:
            module.central = central
            stack.enter_context(module.running())
        yield central


def deliver(lid: Lid, coordinator: Coordinator) -> LocalCentral:
    """Let one object be carried; what is left of central has the journal."""
    with robot(lid, coordinator) as central, connect("somebody", central) as somebody:
        central.advance(SETTLED)
        carrying = somebody.command(CARRY_OBJECTS, 1)
        central.advance(STRIDE)
        while carrying.state == "running":
            central.advance(STRIDE)
        carrying.result()
    return central
