"""The Ambler's walking constraints plan at most one step ahead, in every order of events.

The scenario has the modules, handlers and messages of robots/ambler_sim/modules. Its messages have
the robot's names and simpler data: the number of remaining steps. The last test compares the
scenario with the real modules.
"""

import time
from contextlib import ExitStack
from itertools import pairwise
from typing import Any

import pytest
from explore.scenarios import assert_good

import tca_tools.explore as tca
from dev.invariants import check_invariants
from robots.ambler_sim import messages
from robots.ambler_sim.machine.making import make_robot
from robots.ambler_sim.modules import (
    controller,
    gait_planner,
    mapper,
    planners,
    scanner,
)
from robots.ambler_sim.vocabulary import Arc, Pose
from tca_module import Broadcast, Command, Goal, PointMonitor, Query, connect, this
from tca_module.testing import LocalCentral
from tca_tools.check.events import check_event
from tca_tools.check.world import JournalWorld
from tca_tools.explore import (
    Property,
    Scenario,
    Script,
    Task,
    achieved,
    always,
    at_most,
    before,
    begun,
    never_stuck,
)
from tca_wire.journal.facts import Received
from tca_wire.points import Moment

TRAVERSE_ARC, TAKE_STEPS = Goal("traverse arc", int), Goal("take steps", int)
MOVE_LEG, MOVE_BODY = Command("move leg", int), Command("move body", int)
PLAN_FOOTFALL: Query[None, None] = Query("plan footfall", reply=None)
PLAN_LEG_RECOVERY: Query[None, None] = Query("plan leg recovery", reply=None)
PLAN_BODY_MOVE: Query[None, None] = Query("plan body move", reply=None)
ELEVATION_MAP: Query[None, None] = Query("elevation map", reply=None)
ACQUIRE_IMAGE = Command("acquire image", int)
IMAGES: Query[None, None] = Query("images", reply=None)
RANGES: Query[None, None] = Query("ranges", reply=None)
STANCE: Query[None, None] = Query("stance", reply=None)
POSITION_REACHED = Query("position reached", int, reply=int)
WALKED = Broadcast("walked", int)
ACHIEVED_POSITION = PointMonitor(
    "achieved position?", int, condition=POSITION_REACHED, action=WALKED
)


def walk(steps: int, *properties: Property, plans_ahead: bool = True) -> Scenario:
    scenario = Scenario(f"a walk of {steps} steps", *properties)

    @scenario.module("user").does
    def order_a_walk(me: Script) -> None:
        me.goal(TRAVERSE_ARC, steps).wait()

    plan_gait(scenario, plans_ahead=plans_ahead)
    plan_moves(scenario)
    control(scenario)
    return scenario


def plan_gait(scenario: Scenario, *, plans_ahead: bool) -> None:
    planner = scenario.module("gait planner")
    planner.resource("position check")

    @planner.handles(TRAVERSE_ARC)
    def traverse_arc(task: Task, steps: int) -> None:
        task.query(STANCE)
        image = task.command(ACQUIRE_IMAGE, steps)
        task.goal(TAKE_STEPS, steps, constraints=[image.achieving.end <= this.planning.start])

    @planner.handles(TAKE_STEPS)
    def take_steps(task: Task, left: int) -> None:
        task.query(PLAN_FOOTFALL)
        task.query(PLAN_LEG_RECOVERY)
        task.query(PLAN_BODY_MOVE)
        # The next step is planned after the start of this one. Otherwise planning has no limit.
        started = [task.achieving.start <= this.planning.start]
        if left % 2 == 0:
            image = task.command(ACQUIRE_IMAGE, left)
            started = [image.achieving.end <= this.planning.start]
        task.command(MOVE_LEG, left)
        task.command(MOVE_BODY, left)
        task.monitor(ACHIEVED_POSITION, left)
        if left > 1:
            task.goal(TAKE_STEPS, left - 1, constraints=started if plans_ahead else [])

    @planner.handles(POSITION_REACHED, resource="position check")
    def position_reached(task: Task, left: int) -> int:
        task.query(STANCE)
        return left


def plan_moves(scenario: Scenario) -> None:
    names = "footfall planner", "leg recovery planner", "body planner", "mapper"
    feet, legs, body, mapper = map(scenario.module, names)

    @feet.handles(PLAN_FOOTFALL)
    def footfall(task: Task) -> None:
        task.query(ELEVATION_MAP)

    @legs.handles(PLAN_LEG_RECOVERY)
    def leg_recovery(task: Task) -> None:
        task.query(ELEVATION_MAP)

    @body.handles(PLAN_BODY_MOVE)
    def body_move(_: Task) -> None: ...

    @mapper.handles(ELEVATION_MAP)
    def elevation_map(task: Task) -> None:
        task.query(IMAGES)


def control(scenario: Scenario) -> None:
    controller = scenario.module("controller")
    scanner = scenario.module("scanner")
    controller.resource("range finder")
    scanner.resource("image queue")

    @scanner.handles(ACQUIRE_IMAGE)
    def acquire_image(task: Task, _: int) -> None:
        with task.lock("controller", "controller"):
            task.query(RANGES)

    @scanner.handles(IMAGES, resource="image queue")
    def images(_: Task) -> None: ...

    @controller.handles(MOVE_LEG)
    @controller.handles(MOVE_BODY)
    @controller.handles(STANCE)
    @controller.handles(RANGES, resource="range finder")
    def act(_: Task) -> None: ...


# --- properties of all runs -----------------------------------------------------------------------

Orders = set[tuple[str, str, tuple[Any, ...]]]


def steps_planned_ahead(world: tca.World) -> list[Any]:
    """Return the steps whose planning has started, but whose achieving has not."""
    return [
        task
        for task in world.tasks
        if task.message == TAKE_STEPS.name
        and task.is_begun
        and not task.has(Moment.START_ACHIEVING)
    ]


def at_the_machine(world: tca.World) -> list[Any]:
    moves = (MOVE_LEG.name, MOVE_BODY.name, STANCE.name)
    return [seen for seen in world.messages if seen.message in moves and seen.is_handled]


def steps_in_order(steps: int) -> list[Any]:
    """Return the properties that each move follows the move before it."""
    moves = [
        (message, left)
        for left in range(steps, 0, -1)
        for message in (MOVE_LEG, MOVE_BODY, ACHIEVED_POSITION)
    ]
    return [before(achieved(*one), begun(*following)) for one, following in pairwise(moves)]


def checked_walk(steps: int) -> tca.Scenario:
    return walk(
        steps,
        at_most(1, steps_planned_ahead),
        at_most(1, at_the_machine),
        *steps_in_order(steps),
        never_stuck(),
    )


@pytest.mark.soak
@pytest.mark.parametrize("steps", [2, 5])
def test_ambler_plans_exactly_one_step_ahead(steps: int) -> None:
    last_ahead = False

    def is_noted(world: tca.World) -> bool:
        nonlocal last_ahead
        last_ahead |= any(step.data == 1 for step in steps_planned_ahead(world))
        return True

    result = assert_good(checked_walk(steps), always(is_noted))
    assert result.longest is not None
    assert result.longest > 18 * steps, "nine messages a step, each of them sent and returned"
    assert last_ahead, "planning is ahead at all"


@pytest.mark.soak
def test_ambler_plans_too_far_ahead_without_constraint() -> None:
    result = tca.explore(walk(3, plans_ahead=False), at_most(1, steps_planned_ahead))
    assert result.violation is not None
    assert result.violation.broken == "at most 1 steps planned ahead"
    assert result.violation.why.startswith("here 2: take steps")
    assert len(result.violation.actions) < 60


# --- comparison with the robot --------------------------------------------------------------------


def orders(world: tca.World) -> Orders:
    """Return the sends of tasks with their constraints: ``(parent, message, ((moment, moment,
    leader), ...))``.
    """
    found = set()
    for task in world.tasks:
        parent = world.parent(task)
        held = world.held(task)
        if all(leader for _, _, leader in held):
            after = tuple(
                (int(at), int(moment), "parent" if leader is parent else leader.message)
                for moment, at, leader in held
                if leader
            )
            found.add((parent.message if parent else "", task.message, after))
    return found


def orders_of_real_walk(monkeypatch: pytest.MonkeyPatch) -> Orders:
    """Return the orders of a walk of three steps by the real modules. The third step is planned
    during the first.
    """
    robot, known, found = make_robot("kinematic"), JournalWorld([], is_whole=True), set()
    with LocalCentral(check=check_invariants) as central, ExitStack() as stack:
        move_leg = robot.move_leg

        def move_when_planned(*arguments: Any, **options: Any) -> Any:
            deadline = time.monotonic() + 10
            while (
                sum(isinstance(f, Received) and f.message == TAKE_STEPS.name for f in central.facts)
                < 3
            ):
                assert time.monotonic() < deadline, (
                    "the third step is not planned while the first is walked"
                )
                time.sleep(0.002)
            return move_leg(*arguments, **options)

        monkeypatch.setattr(robot, "move_leg", move_when_planned)
        modules = [
            gait_planner.planner,
            *planners.PLANNERS.values(),
            scanner.scanner,
            mapper.mapper,
        ]
        for module in (*modules, controller.make_module(robot, None)):
            monkeypatch.setattr(module, "central", central)
            stack.enter_context(module.running())
        with connect("user", central) as user:
            user.goal(messages.TRAVERSE_ARC, Arc(Pose(0.0, 0.0, 0.0, 0.0), 0.0, 1.2)).wait(
                timeout=20
            )
        for entry in central.entries:
            known.forget()
            check_event(known, entry)
            found |= orders(tca.World(known, {}))
    return found


@pytest.mark.soak
def test_ambler_scenario_sends_the_robots_messages(monkeypatch: pytest.MonkeyPatch) -> None:
    played: Orders = set()

    def is_noted(world: tca.World) -> bool:
        played.update(orders(world))
        return True

    assert_good(checked_walk(3), always(is_noted))
    real = orders_of_real_walk(monkeypatch)
    assert {order[:2] for order in real} == {order[:2] for order in played}
    assert real <= played
    ahead = {
        order[:2]
        for order in real
        if any(moment == int(Moment.START_PLANNING) for _, moment, _ in order[2])
    }
    assert ("take steps", "take steps") in ahead
