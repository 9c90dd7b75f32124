"""All of the robot in one process, on a clock that is stepped: the same delivery comes out the same
every time.
"""

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

SETTLED = 1.0
"""Seconds that perception has to look around before an object is given."""

STRIDE = 1.0


@contextmanager
def running(
    robot: SimulatedRobot, *modules: Module, has_steps: bool = False
) -> Iterator[LocalCentral]:
    """What moves the robot and looks into box B, and these modules; the caller steps their
    clock.
    """
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
    """All modules, with the kinematic twin."""
    simulated = SimulatedRobot(KinematicManipulator(), lid)
    with running(
        simulated, coordination.make_module(coordinator), user.make_module(coordinator)
    ) as central:
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
