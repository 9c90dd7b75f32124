"""The Ambler's walk as a scenario: who handles what, and what it sends, as in robots/ambler_sim/modules.

The messages are called as the robot's and have simpler data: the number of steps that are left. test_ambler.py holds the
scenario against the real modules.
"""

from tca_explorer import Property, Scenario, Script, Task
from tca_module import Broadcast, Command, Goal, PointMonitor, Query, this

TRAVERSE_ARC, TAKE_STEPS = Goal("traverse arc", int), Goal("take steps", int)
MOVE_LEG, MOVE_BODY = Command("move leg", int), Command("move body", int)
PLAN_LEG_MOVE: Query[None, None] = Query("plan leg move", reply=None)
PLAN_BODY_MOVE: Query[None, None] = Query("plan body move", reply=None)
ELEVATION_MAP: Query[None, None] = Query("elevation map", reply=None)
SCAN: Query[None, None] = Query("scan", reply=None)
STANCE: Query[None, None] = Query("stance", reply=None)
POSITION_REACHED = Query("position reached", int, reply=int)
WALKED = Broadcast("walked", int)
ACHIEVED_POSITION = PointMonitor("achieved position?", int, condition=POSITION_REACHED, action=WALKED)


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
        task.goal(TAKE_STEPS, steps)

    @planner.handles(TAKE_STEPS)
    def take_steps(task: Task, left: int) -> None:
        task.query(PLAN_LEG_MOVE)
        task.query(PLAN_BODY_MOVE)
        task.command(MOVE_LEG, left)
        task.command(MOVE_BODY, left)
        task.monitor(ACHIEVED_POSITION, left)
        if left > 1:
            # Planned once this one is being achieved: the constraint without which planning runs away.
            constraints = [task.achieving.start <= this.planning.start] if plans_ahead else []
            task.goal(TAKE_STEPS, left - 1, constraints=constraints)

    @planner.handles(POSITION_REACHED, resource="position check")
    def position_reached(task: Task, left: int) -> int:
        task.query(STANCE)
        return left


def plan_moves(scenario: Scenario) -> None:
    legs, body, perception = (scenario.module(name) for name in ("leg planner", "body planner", "perception"))

    @legs.handles(PLAN_LEG_MOVE)
    def leg_move(task: Task) -> None:
        task.query(ELEVATION_MAP)

    @body.handles(PLAN_BODY_MOVE)
    def body_move(_: Task) -> None: ...

    @perception.handles(ELEVATION_MAP)
    def elevation_map(task: Task) -> None:
        if task.choose("the map is fresh", "the map is old") == "the map is old":
            task.query(SCAN)


def control(scenario: Scenario) -> None:
    controller = scenario.module("controller")
    controller.resource("scanner")

    @controller.handles(MOVE_LEG)
    @controller.handles(MOVE_BODY)
    @controller.handles(STANCE)
    @controller.handles(SCAN, resource="scanner")
    def act(_: Task) -> None: ...
