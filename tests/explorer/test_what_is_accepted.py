"""What central has accepted it does, or says why not: whatever comes in between.

One scenario (accepting.py) for what can be asked of a task, and a table of what *kept* means of each. Whatever is asked
once, at any moment; kills, losses, a suspension, a failure and a retry come before it, after it, or while it waits.
Nobody may be left waiting, either. What is asked of other things is in
test_what_else_is_accepted.py, what is asked for in test_what_is_given.py.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import pytest
from explorer.accepting import BETWEEN, EVER, HELP, at_once, good, robot, those
from explorer.scenarios import LIFT, SLIPPED, STEP
from sampling import one_in

from tca_explorer import Scenario, Script, Seen, Task, World, accepted, before, begun, within
from tca_module import Scope
from tca_module.sending.task_ref import TaskRef


class Request(NamedTuple):
    """Something that is asked of a step, and when it is kept."""

    call: str
    ask: Callable[[Any, TaskRef], object]
    kept: Callable[[World], object]
    seconds: float = 0
    """How long after; 0: at once."""


def gone(world: World) -> bool:
    """No step is left that was not killed."""
    return all(one.is_killed or one.is_over for one in those(world, STEP))


def parted(world: World) -> bool:
    """It ended unharmed, or was killed before it began, or what leaves things safe is done before its end."""
    ended = those(world, STEP, "is_over")
    return bool(those(world, LIFT, "is_over")) or any(not (one.is_killed and one.is_begun) for one in ended)


def timed_out(world: World) -> bool:
    return gone(world) or any(one.failure == "timeout" for one in those(world, STEP))


def handled_again(world: World) -> bool:
    return gone(world) or bool(those(world, STEP, "is_handled", data="again"))


def held(world: World) -> bool:
    return gone(world) or bool(those(world, STEP, "is_suspended"))


def failed(world: World) -> bool:
    return gone(world) or bool(those(world, HELP) or those(world, STEP, "failure"))


def suspend_and_resume(_: Any, step: TaskRef) -> None:
    step.suspend()
    step.resume()


def kill_all_under_the_walk(_: Any, step: TaskRef) -> None:
    if (walk := step.parent()) is not None:
        walk.kill(scope=Scope.DESCENDANTS)


REQUESTS = {
    "kill": Request("kill", lambda _, step: step.kill(), gone),
    "kill in 1 s": Request("kill", lambda _, step: step.kill(delay=1.0), gone, 1.0),
    "kill after its handling": Request("kill", lambda _, step: step.kill(after=step.handling.end), gone, EVER),
    "kill of all beside it": Request(
        "kill", lambda me, _: me.command(LIFT, sequential=False).kill(scope=Scope.SIBLINGS), gone
    ),
    "kill of all under the task above": Request("kill", kill_all_under_the_walk, gone),
    "on termination": Request("on_termination", lambda _, step: step.on_termination(LIFT), parted, EVER),
    "deadline": Request("deadline", lambda _, step: step.deadline(5.0), timed_out, 5.0),
    "retry": Request("retry", lambda _, step: step.retry(STEP, "again"), handled_again, EVER),
    "suspend": Request("suspend", suspend_and_resume, held),
    "resume": Request("resume", suspend_and_resume, gone, EVER),
    "failure": Request("fail", lambda _, step: step.fail(SLIPPED(text="seen from afar")), failed),
}


@pytest.mark.parametrize(("name", "between"), one_in(6, REQUESTS, BETWEEN))
def test_what_is_asked_of_a_task(name: str, between: str) -> None:
    request = REQUESTS[name]
    ends_it = between in ("loss of who asked", "loss of who handles it")
    is_timed = 0 < request.seconds < EVER and not ends_it
    scenario = robot(name, request.ask, BETWEEN[between] + ", last" * is_timed)
    properties = [within(request.seconds, accepted(request.call), request.kept)]
    if not request.seconds:
        properties.append(at_once(request.call, request.kept))
    good(scenario, *properties)


def killed_and_over(world: World) -> list[Seen]:
    return those(world, STEP, "is_killed", "is_over")


def test_what_a_handler_keeps_for_its_termination_is_done_before_its_end() -> None:
    """Also where the kill came first, and the handler did not know yet."""
    scenario = Scenario("a brake that was asked for is used")
    motor, brake, user = scenario.module("motor"), scenario.module("brake"), scenario.module("user")

    @motor.handles(STEP)
    def spin(task: Task) -> None:
        task.ref.on_termination(LIFT)

    brake.handles(LIFT)(lambda _: None)

    @user.does
    def story(me: Script) -> None:
        me.command(STEP).kill()

    good(scenario, before(begun(LIFT), killed_and_over))
