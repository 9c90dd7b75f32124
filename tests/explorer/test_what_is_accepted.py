"""What central has accepted it does, whatever comes in between: kills, failures, losses."""

from explorer.scenarios import LIFT, STEP

from tca_explorer import Scenario, Script, Task, World, before, begun, explore, report


def killed_and_over(world: World) -> list[object]:
    return [task for task in world.tasks if task.message == STEP.name and task.is_killed and task.is_over]


def test_what_is_kept_for_the_termination_of_a_killed_task_is_sent() -> None:
    """Also where the kill came first, and the handler did not know yet."""
    scenario = Scenario("a brake that was asked for is used", before(begun(LIFT), killed_and_over))
    motor, brake, user = scenario.module("motor"), scenario.module("brake"), scenario.module("user")

    @motor.handles(STEP)
    def spin(task: Task) -> None:
        task.handle.on_termination(LIFT)

    brake.handles(LIFT)(lambda _: None)

    @user.does
    def story(me: Script) -> None:
        me.command(STEP).kill()

    result = explore(scenario)
    assert result.ok, report(result)
    assert not result.vacuous
