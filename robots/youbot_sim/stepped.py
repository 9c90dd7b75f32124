"""The whole robot in one process on a stepped clock: a delivery always gives the same result."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from robots.youbot_sim import coordination, moving, perception, simulator, user
from robots.youbot_sim.kinematic import KinematicManipulator
from robots.youbot_sim.messages import CARRY_OBJECTS
from robots.youbot_sim.simulator import Lid, SimulatedRobot
from robots.youbot_sim.vocabulary import GROUPS
from tca_behaviours.coordination import Coordinator
from tca_module import Module, connect
from tca_module.testing import LocalCentral

SETTLING = 1.0
"""Seconds that perception gets before an object is given."""

STRIDE = 1.0
"""Seconds between two checks whether the object has been delivered."""


@contextmanager
def running(
    robot: SimulatedRobot, *modules: Module, has_steps: bool = False
) -> Iterator[LocalCentral]:
    """Run the simulator, the movers, perception and these modules. The caller steps their clock."""
    movers = [moving.make_module(group) for group in GROUPS]
    simulated = simulator.make_module(robot, has_steps=has_steps)
    with ExitStack() as stack:
        central = stack.enter_context(LocalCentral(stepped=True))
        for module in (simulated, *movers, perception.make_module(), *modules):
            module.central = central
            stack.enter_context(module.running())
        yield central


@contextmanager
def robot(lid: Lid, coordinator: Coordinator) -> Iterator[LocalCentral]:
    """Run all modules, with the kinematic backend."""
    simulated = SimulatedRobot(KinematicManipulator(), lid)
    with running(
        simulated, coordination.make_module(coordinator), user.make_module(coordinator)
    ) as central:
        yield central


def deliver(lid: Lid, coordinator: Coordinator) -> LocalCentral:
    """Have one object carried. Returns the ended central, which has the journal."""
    with robot(lid, coordinator) as central, connect("requester", central) as requester:
        central.advance(SETTLING)
        carrying = requester.command(CARRY_OBJECTS, 1)
        central.advance(STRIDE)
        while carrying.state == "running":
            central.advance(STRIDE)
        carrying.result()
    return central
