"""The whole robot in one process, on a stepped clock, so that a seed always gives the same run."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

from robots.office_sim.layers import battery, grasps, vanished_cups
from robots.office_sim.messages import CALL_IT_A_DAY, KEEP_FLOOR_FREE, OPEN_LAB, SCENE
from robots.office_sim.modules import controller, planner, simulator, task_manager, vision
from robots.office_sim.vocabulary import CupState, LabScene, SeenCup
from robots.office_sim.world import OfficeWorld
from tca_module import Client, Module, connect
from tca_module.testing import LocalCentral

MakeModule = Callable[[float], Module]
LAYERS: tuple[MakeModule, ...] = (
    vanished_cups.make_module,
    battery.make_module,
    grasps.make_module,
)
WALKING: tuple[MakeModule, ...] = tuple(
    each.make_module for each in (vision, controller, planner, task_manager)
)
LONG = 2000.0
"""Seconds within which all cups must be gone."""


@contextmanager
def office(
    world: OfficeWorld, layers: tuple[MakeModule, ...] = LAYERS
) -> Iterator[tuple[LocalCentral, Client]]:
    """Run all modules in an open lab, and a client. The caller steps the clock."""
    modules = [simulator.make_module(world, 1.0), *(make(1.0) for make in (*WALKING, *layers))]
    with ExitStack() as stack:
        central = stack.enter_context(LocalCentral(stepped=True))
        for module in modules:
            module.central = central
            stack.enter_context(module.running())
        user = stack.enter_context(connect("user", central))
        user.inform(OPEN_LAB)
        yield central, user


def run_until_clean(
    world: OfficeWorld,
    look: Callable[[Client, LabScene], None],
    layers: tuple[MakeModule, ...] = LAYERS,
) -> tuple[LocalCentral, LabScene]:
    """Run until no cup is left. Call *look* every second."""
    with office(world, layers) as (central, user):
        keeping = user.goal(KEEP_FLOOR_FREE)
        central.until_quiet()  # else the client's query races with the goal's messages
        while has_cups_left(scene := user.query(SCENE)):
            assert scene.time < LONG
            look(user, scene)
            central.advance(1.0)
        user.inform(CALL_IT_A_DAY)
        central.advance(60.0)
        keeping.result(timeout=0)
        return central, user.query(SCENE)


def has_cups_left(scene: LabScene) -> bool:
    return any(cup.state not in (CupState.BIN, CupState.TAKEN) for cup in scene.cups)


def the(scene: LabScene, state: CupState) -> list[SeenCup]:
    return [cup for cup in scene.cups if cup.state is state]
