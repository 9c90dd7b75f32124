"""A retry policy with a fallback: its rules hold in every order of events, failures and kills."""

from explore.accepting import has_ended, messages_with
from explore.scenarios import REST, STEP, WALK, assert_good, slips_or_not

import tca_tools.explore as tca
from tca_module import Retry
from tca_tools.explore import at_most_in_all, eventually, never, never_stuck, retried, sent


def attempt_beside_the_fallback(world: tca.World) -> bool:
    fallbacks = messages_with(world, REST, "is_begun")
    return bool(fallbacks and messages_with(world, STEP, "is_handled"))


def test_fallback_replaces_the_task_once_after_all_attempts() -> None:
    scenario = tca.Scenario(
        "a retry policy",
        never_stuck(),
        eventually(has_ended(WALK)),
        at_most_in_all(2, retried(STEP)),  # the second time, the fallback replaces it
        at_most_in_all(1, sent(REST)),
        never(attempt_beside_the_fallback),
    )
    planner, user = scenario.module("planner"), scenario.module("user")
    scenario.module("legs").handles(STEP)(slips_or_not)
    scenario.module("winch").handles(REST)(slips_or_not)

    @planner.handles(WALK)
    def walk(task: tca.Task) -> None:
        task.command(STEP, retry=Retry(2, pause=1, attempt_timeout=5, otherwise=REST))

    @user.does
    def use(me: tca.Script) -> None:
        me.goal(WALK)

    scenario.may_kill(STEP)
    result = assert_good(scenario)
    assert result.is_complete
    assert not result.vacuous
