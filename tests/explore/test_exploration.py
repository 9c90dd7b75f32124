"""The search: equal states, checks, order and reports."""

import contextlib
import re
from collections.abc import Callable
from typing import Any

import pytest
from explore.scenarios import NOTE, REST, STEP, WALK, WHERE, assert_good, counterexample, walking
from explore.test_good_verdicts import polled

import tca_tools.explore as tca
from dev.invariants import check_invariants
from tca_central.core import Central
from tca_central.model.resources import Queue
from tca_module import TaskFailed, TaskKilled
from tca_tools.explore import (
    achieved,
    always,
    at_most_in_all,
    before,
    begun,
    eventually,
    never,
    never_stuck,
    sent,
)
from tca_tools.explore.play.play import Play
from tca_tools.explore.search.snapshot import Snapshots
from tca_wire.messages.declarations import Command


def independent_users(
    *properties: tca.Property, names: tuple[str, str] = ("one", "other")
) -> tca.Scenario:
    """Return a scenario with two independent users. Each sends a command that takes no time."""
    scenario = tca.Scenario("strangers", *properties)
    for name in names:
        command = Command(name)
        scenario.module(f"{name}'s").handles(command)(lambda _: None)
        scenario.module(name).does(lambda me, command=command: [me.command(command)])
    return scenario


def both_running(world: tca.World) -> bool:
    return len(world.tasks) == 2 and not any(task.is_over for task in world.tasks)


def one_by_one(world: tca.World) -> bool:
    return any(task.is_over for task in world.tasks) and len(world.tasks) == 1


def other_first(world: tca.World) -> bool:
    return (
        any(task.message == "other" and task.is_over for task in world.tasks)
        and len(world.tasks) == 2
    )


@pytest.mark.parametrize("names", [("one", "other"), ("other", "one")])
@pytest.mark.parametrize("may_be", [both_running, other_first])
def test_memory_of_property_is_part_of_state(names: tuple[str, str], may_be: Any) -> None:
    """Both commands end, overlapping or not. The order in which they are tried does not matter."""
    counterexample(independent_users(eventually(may_be), names=names))
    counterexample(independent_users(eventually(nothing), names=names))
    assert_good(
        independent_users(
            eventually(lambda world: both_running(world) or one_by_one(world)), names=names
        )
    )
    counterexample(independent_users(before(may_be, both_over), names=names))


def nothing(_: tca.World) -> bool:
    return False


def both_over(world: tca.World) -> bool:
    """Whether both commands have ended, the last one just now."""
    return len(world.tasks) == 1 and all(task.is_over for task in world.tasks)


def test_count_of_property_is_part_of_state() -> None:
    """The note is sent once or twice; nothing else distinguishes the runs."""
    scenario = tca.Scenario("counting")
    scenario.module("ear").handles(NOTE)(lambda _: None)

    @scenario.module("mouth").does
    def send_notes(me: tca.Script) -> None:
        if me.choose("once", "twice") == "twice":
            me.inform(NOTE)
        me.inform(NOTE)

    assert_good(scenario, at_most_in_all(2, sent(NOTE)))
    counterexample(scenario, at_most_in_all(1, sent(NOTE)))


def test_exploration_checks_invariants_of_central(monkeypatch: pytest.MonkeyPatch) -> None:
    """A queue that miscounts is not visible from outside."""
    real = Queue.mark_void

    def left(self: Queue[Any]) -> None:
        real(self)
        self.waiting += 1

    assert_good(walking(never_stuck()))
    monkeypatch.setattr(Queue, "mark_void", left)
    result = tca.explore(walking(never_stuck()), check=check_invariants)
    assert result.violation is not None
    assert result.violation.broken == "central's own invariants"
    assert result.violation.why
    assert tca.report(result).splitlines()[1].startswith("  1. user sends goal walk")


def test_first_state_is_judged() -> None:
    result = tca.explore(walking(never(lambda world: not world.messages)))
    assert result.violation is not None
    assert result.violation.actions == ()


def test_last_states_are_judged_at_the_limit() -> None:
    states = tca.explore(walking(never_stuck())).states
    assert_good(walking(never_stuck()), limit=states)
    result = tca.explore(walking(never_stuck()), limit=states - 1)
    assert result.is_complete is False
    assert "not known" in tca.report(result)


def test_exploration_counts_states_steps_and_ends() -> None:
    """Two commands, each sent and returned, in all orders: a grid of nine states."""
    result = tca.explore(independent_users(never_stuck()))
    assert (result.states, result.steps, result.ends, result.longest) == (9, 12, 1, 4)
    assert result.vacuous == ()


def test_watch_callback_receives_progress() -> None:
    progress: list[tuple[int, int]] = []
    result = tca.explore(
        walking(never_stuck()), watch=lambda states, to_go: progress.append((states, to_go))
    )
    assert progress
    assert all(0 < states <= result.states and 0 <= to_go < states for states, to_go in progress)
    assert progress == sorted(progress, key=lambda one: one[0])


# --- snapshots ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "scenario",
    [walking(never_stuck(), may_be_lost=1, comes_back=True), polled(never_stuck())],
    ids=["walking", "polled"],
)
def test_play_snapshot_and_replay_give_the_same_states(
    scenario: tca.Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = tca.explore(scenario, limit=40)
    for room in ("MAX_PLAYS", "SNAPSHOT_BYTES"):
        monkeypatch.setattr(f"tca_tools.explore.search.exploration.{room}", 0)
        again = tca.explore(scenario, limit=40)
        assert (kept.states, kept.steps, kept.ends) == (again.states, again.steps, again.ends)


def test_snapshot_memory_is_released(monkeypatch: pytest.MonkeyPatch) -> None:
    """The walk has more snapshots than fit into the memory."""
    made: list[int] = []
    real = Snapshots.save

    def save(self: Snapshots, play: Play) -> bytes:
        made.append(1)
        return real(self, play)

    monkeypatch.setattr(Snapshots, "save", save)
    monkeypatch.setattr("tca_tools.explore.search.exploration.MAX_PLAYS", 0)
    monkeypatch.setattr("tca_tools.explore.search.exploration.SNAPSHOT_BYTES", 1_000_000)
    result = tca.explore(walking(never_stuck()))
    assert result.ok
    assert len(made) == result.states
    made.clear()
    monkeypatch.setattr("tca_tools.explore.search.exploration.SNAPSHOT_BYTES", 10_000)
    assert_good(walking(never_stuck()))
    assert 0 < len(made) < result.states


def test_snapshot_is_loaded_into_independent_copies() -> None:
    """Actions on one copy affect neither another copy nor the play."""
    play, snapshots = Play(walking()), Snapshots()
    snapshot = snapshots.save(play)
    one, other = snapshots.load(snapshot), snapshots.load(snapshot)
    while actions := one.actions():
        one.perform(actions[0])
    assert [str(action) for action in other.actions()] == [str(action) for action in play.actions()]
    assert one.central is not other.central
    other.perform(other.actions()[0])
    assert not play.world.items
    assert other.world.items


# --- order of the search --------------------------------------------------------------------------


def test_shorter_of_two_counterexamples_is_shown() -> None:
    scenario = tca.Scenario("two ways", never(sent(STEP)))
    legs = scenario.module("legs")
    legs.handles(STEP)(lambda _: None)
    legs.handles(REST)(lambda _: None)

    @scenario.module("planner").handles(WALK)
    def walk(task: tca.Task) -> None:
        task.command(STEP)

    @scenario.module("user").does
    def story(me: tca.Script) -> None:
        for _ in range(me.choose(2, 0, 1)):
            me.goal(REST).wait()
        me.goal(WALK)

    result = tca.explore(scenario)
    assert result.violation is not None
    assert len(result.violation.actions) == 2
    assert "chooses 0" in tca.report(result)


def test_ended_run_is_judged_before_continuing_one() -> None:
    """A run that ends in a state has a shorter counterexample than one that continues."""
    result = tca.explore(walking(never_stuck(), never(achieved(WALK)), steps=1))
    assert result.violation is not None
    assert len(result.violation.actions) == 4


# --- equality of states ---------------------------------------------------------------------------


def ended_long_ago(me: tca.Script) -> object:
    """Return the result of a step that ended earlier. Only the result is left of the step."""
    step = me.command(STEP)
    me.goal(REST).wait()
    return step.result()


def was_not_read_yet(me: tca.Script) -> object:
    where = me.query_send(WHERE)
    me.goal(REST).wait()
    return where.receive()


def was_decided(me: tca.Script) -> object:
    decided = me.choose(1, 2)
    me.goal(REST).wait()
    return decided


@pytest.mark.parametrize("later", [ended_long_ago, was_not_read_yet, was_decided])
@pytest.mark.parametrize("result", [1, 2])
def test_state_keeps_value_that_is_sent_later(
    later: Callable[[tca.Script], object], result: int
) -> None:
    """Only this value distinguishes the runs before the note."""
    scenario = tca.Scenario("told later")
    legs = scenario.module("legs")
    legs.handles(STEP)(lambda task: task.choose(1, 2))
    legs.handles(WHERE)(lambda task: task.choose(1, 2))
    legs.handles(REST)(lambda _: None)
    legs.handles(NOTE)(lambda _: None)
    scenario.module("user").does(lambda me: me.inform(NOTE, later(me)))
    counterexample(scenario, never(sent(NOTE, result)))


def lost_or_killed(*properties: tca.Property) -> tca.Scenario:
    """Return a scenario with a step that may be killed once, on legs that may be lost once. The
    faults that may still come are part of the state.
    """
    scenario = tca.Scenario("still to come", *properties)
    scenario.module("legs", may_be_lost=1, comes_back=True).handles(STEP)(lambda _: None)

    @scenario.module("user").does
    def story(me: tca.Script) -> None:
        for _ in range(2):
            with contextlib.suppress(TaskFailed, TaskKilled):
                me.command(STEP).wait()

    scenario.may_kill(STEP)
    return scenario


@pytest.mark.soak
def test_state_keeps_remaining_losses_and_kills() -> None:
    counterexample(lost_or_killed(never_stuck(), never(killed_and_over)))
    counterexample(lost_or_killed(never_stuck()), at_most_in_all(1, ended_badly))
    properties = at_most_in_all(1, killed_and_over), at_most_in_all(2, ended_badly)
    assert_good(lost_or_killed(never_stuck(), *properties))


def killed_and_over(world: tca.World) -> list[tca.Seen]:
    return [task for task in world.tasks if task.is_over and task.is_killed and not task.failure]


def ended_badly(world: tca.World) -> list[tca.Seen]:
    return [task for task in world.tasks if task.is_over and task.is_killed]


@pytest.mark.parametrize("seconds", [1.0, 2.0])
def test_state_keeps_remaining_delay(seconds: float) -> None:
    """Only the chosen delay distinguishes the runs before the step."""
    scenario = tca.Scenario("how long")
    scenario.module("legs").handles(STEP)(lambda _: None)

    @scenario.module("user").does
    def story(me: tca.Script) -> None:
        me.command(STEP, delay=1.0 if me.choose("soon", "late") == "soon" else 2.0)

    counterexample(scenario, never(lambda world: world.passed == seconds))
    assert_good(scenario, never(lambda world: world.passed not in (0.0, 1.0, 2.0)))


# --- reports: one line, or the shortest counterexample ---------------------------------------------


SHORTEST = """\
walking: NOT rest achieved before walk achieved
  1. user sends goal walk
       received: goal walk {1} from user
       delivered: walk {1} to planner
       reached: walk {1}: start handling, start planning
       reached: walk {1}: start achieving
  2. planner in walk {1} sends command step 0
       received: command step {2} from planner under walk {1}
       reached: step {2}: start planning, end planning
       delivered: step {2} to legs
       reached: step {2}: start handling, start achieving
  3. planner in walk {1} returns
       returned: walk {1}: done
       reached: walk {1}: end handling, end planning
  4. legs in step {2} returns
       returned: step {2}: done
       reached: step {2}: end handling, end achieving
       reached: walk {1}: end achieving
  => the second came first: walk {1}
"""


def test_shortest_counterexample_is_shown() -> None:
    shown = counterexample(walking(before(achieved(REST), achieved(WALK)), steps=1))
    assert re.sub(r" \(after \d+ states\)", "", shown) + "\n" == SHORTEST


def test_no_shorter_counterexample_exists() -> None:
    """No walk ends within three actions, so the counterexample has four."""
    result = tca.explore(walking(never(achieved(WALK)), steps=1))
    assert result.violation is not None
    assert len(result.violation.actions) == 4


def test_good_result_is_one_line() -> None:
    result = tca.explore(walking(never_stuck()))
    assert re.fullmatch(r"walking: good, \d+ states, at most 9 actions a run", tca.report(result))


def test_result_is_unknown_at_the_limit() -> None:
    result = tca.explore(walking(never_stuck()), limit=20)
    assert not result.ok
    first, second = tca.report(result).splitlines()
    assert (
        first
        == "walking: not known, nothing wrong in the first 21 states: make the scenario smaller, or raise the limit"
    )
    assert second.startswith("  commonest alternatives: steps of user (")


def stuck() -> tca.Result:
    """Explore a scenario in which a handler locks its resource, and waits for a task there."""
    scenario = tca.Scenario("a short circuit", never_stuck())

    @scenario.module("planner").handles(WALK)
    def walk(task: tca.Task, times: int) -> None:
        if times:
            task.lock("planner")
            task.goal(WALK, times - 1).wait()

    @scenario.module("user").does
    def story(me: tca.Script) -> None:
        me.goal(WALK, 1).wait()

    return tca.explore(scenario)


def test_stuck_tasks_and_waits_are_named() -> None:
    *_, reason, running, queued, handler_wait, user_wait = tca.report(stuck()).splitlines()[-6:]
    assert reason == "  => the run may end here, with this left:"
    assert (
        running.strip()
        == "walk {1} has not ended: start handling, start planning, start achieving; handled by planner"
    )
    assert queued.strip() == "walk {3} has not ended: nothing reached; queued"
    assert handler_wait.strip() == "planner in walk {1} waits for end achieving of walk {3}"
    assert user_wait.strip() == "user waits for end achieving of walk {1}"


def test_assertion_in_central_is_counterexample(monkeypatch: pytest.MonkeyPatch) -> None:
    def settle(self: Central, real: object = Central._process_all) -> None:
        real(self)  # type: ignore[operator]
        assert len(self.tree.tasks) < 3, "too many tasks"

    monkeypatch.setattr(Central, "_process_all", settle)
    result = tca.explore(walking())
    assert result.violation is not None
    assert result.violation.broken == "central handles everything"
    assert "too many tasks" in tca.report(result)


def test_property_describes_its_violation() -> None:
    result = tca.explore(walking(always(lambda world: len(world.tasks) < 2)))
    assert result.violation is not None
    assert result.violation.why == "it is not true here"
    assert str(never(begun(STEP, 1))) == "never step begun with data=1"
    assert str(before(begun(WHERE), begun(STEP))) == "where begun before step begun"
