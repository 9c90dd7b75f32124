"""States with equal fingerprints have equal successors."""

import contextlib
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from random import Random

import pytest
from explore import scenarios
from explore.scenarios import (
    BATTERY,
    CHECK,
    HEIGHTS,
    HIGHER,
    IS_LOW,
    NOTE,
    RECHARGE,
    SLIPPED,
    STEP,
    WALK,
    WHERE,
)
from explore.test_ambler import walk
from sampling import one_in

from tca_central.control.steering import PendingKill
from tca_central.core import Central
from tca_central.events import ConnectionId
from tca_central.model.contexts import FailureContext
from tca_central.model.deliveries import (
    AttachedHandler,
    Connection,
    Delivery,
    MessageType,
    Module,
    ModuleResource,
)
from tca_central.model.registry import Registry
from tca_central.model.resources import Claim
from tca_central.model.task_tree import TaskTree
from tca_central.model.tasks import Tapping, Verdict, Watch
from tca_central.order.holds import PendingDelay
from tca_module import Condition, QueryFailed, Refused, Timeout, this
from tca_tools.explore import Scenario, Script, Task
from tca_tools.explore.observed.world import Name, World
from tca_tools.explore.play.play import Action, ActionKind, Play
from tca_tools.explore.search.fingerprint import IGNORED, SPECIAL, Detail, fingerprint_of
from tca_tools.explore.search.snapshot import Snapshots
from tca_wire.messages.declarations import Variable
from tca_wire.packets.parts import WatchOptions
from tca_wire.vocabulary import Due, Scope

Path = tuple[Action, ...]


def busy() -> Scenario:
    """Return a scenario with most actions of modules, and with pools, priorities, nested queries
    and choices.
    """
    scenario = Scenario("busy")
    for name in ("legs", "more legs"):
        legs = scenario.module(name, may_be_lost=int(name == "legs"), comes_back=True)
        legs.handles(STEP, pool="all")(lambda _: None)
        legs.handles(HEIGHTS)(lambda _: 1)

    planner = scenario.module("planner", capacity=2)

    @planner.handles(WALK)
    def steps(task: Task) -> None:
        try:
            task.query(WHERE, priority=1)
        except QueryFailed:
            task.multi_query(HEIGHTS, maximum=1)
        task.command(STEP, priority=task.choose(0, 1))
        if not task.cancelled:
            task.inform(NOTE)

    @planner.handles(WHERE)
    @planner.handles(NOTE)
    def where(task: Task) -> int | None:
        if task.message == WHERE.name and task.choose("here", "lost") == "lost":
            raise SLIPPED(text="ice")
        return 7 if task.message == WHERE.name else None

    @scenario.module("user").does
    def orders(me: Script) -> None:
        me.goal(WALK).kill()
        me.goal(WALK, sequential=False).wait()

    return scenario


def killing() -> Scenario:
    scenario = scenarios.walking(capacity=2, may_leave=True, slips=True)
    scenario.may_kill(STEP)
    return scenario


def retries(task: Task) -> None:
    task.trouble.failing.retry()


def watched() -> Scenario:
    """Return a scenario with wiretaps, a monitor, a deadline with a retry, later kills, termination
    messages and timeouts.
    """
    scenario = Scenario("watched")
    planner, feet = (
        scenario.module("planner"),
        scenario.module("legs", may_be_lost=1, comes_back=True),
    )
    scenario.module("expert").handles(HIGHER)(retries)
    scenario.module("safety", capacity=2).handles(CHECK)(lambda _: None)
    scenario.module("battery").handles(IS_LOW)(lambda task: task.choose(False, True))
    scenario.module("dock").handles(RECHARGE)(lambda _: None)

    @planner.handles(WALK)
    def walk(task: Task) -> None:
        task.ref.on_termination(RECHARGE)
        task.monitor(BATTERY, period=2.0, maximum=1)
        first = task.command(STEP, 1, deadline=3.0)
        first.on_failure(None, HIGHER, maximum=1)
        second = task.command(
            STEP, 2, delay=1.0, constraints=[first.handling.end + 0.5 <= this.achieving.start]
        )
        second.kill(delay=4.0)
        with contextlib.suppress(Timeout):
            second.wait(timeout=2.5)

    @feet.handles(STEP)
    def step(task: Task) -> None:
        if task.suspended or task.choose("holds", "slips") == "slips":
            raise SLIPPED(text="ice")

    @scenario.module("user").does
    def story(me: Script) -> None:
        me.tap(Condition.BEFORE_HANDLING, STEP, CHECK)
        me.tap(Condition.WHILE_ACHIEVING, STEP, CHECK)
        with contextlib.suppress(Refused):
            me.goal(WALK).suspend()

    scenario.may_suspend(WALK)
    scenario.may_kill(WALK)
    return scenario


SCENARIOS = {
    "watched": (watched, 200),
    "ladder": (scenarios.ladder, 250),
    "suspended": (scenarios.suspending, 250),
    "late": (lambda: scenarios.late(handled=True), 150),
    "polling": (lambda: scenarios.polling(BATTERY, maximum=2, fire_every=2), 60),
    "busy": (busy, 250),
    "killing": (killing, 250),
    "arriving": (lambda: scenarios.walking(arrives_late=True, capacity=2, may_be_lost=1), 200),
    "ambler": (lambda: walk(2), 150),
}


DETAILS = {"short": Detail(), "with names": Detail(names=True)}


def play(scenario: Scenario, path: Path) -> Play:
    played = Play(scenario)
    for action in path:
        played.perform(action)
    return played


def successors(
    path: Path, played: Callable[[], Play], detail: Detail, views: dict[bytes, object]
) -> Iterator[tuple[Path, Play, bytes]]:
    """Yield the successors of a play, each with its state. Check that properties see equal states
    as equal.
    """
    for action in played().actions():
        after = played()
        after.perform(action)
        key, order = fingerprint_of(after, (), detail)
        after.world.forget()  # the next action would do the same first
        view = seen_in(World(after.world, {message: place for place, message in enumerate(order)}))
        assert views.setdefault(key, view) == view, path
        yield (*path, action), after, key


def seen_in(world: World) -> object:
    """Return everything that a property can see, with names for ids."""
    names: list[Name] = []

    def name(one: Name) -> int:
        if one not in names:
            names.append(one)
        return names.index(one)

    return (
        [
            {
                key: name(value) if isinstance(value, Name) else value
                for key, value in vars(seen).items()
            }
            for seen in world.messages
        ],
        [[child.message for child in world.children(seen)] for seen in world.messages],
        [
            [(at, moment, leader and name(leader.id)) for at, moment, leader in world.held(seen)]
            for seen in world.messages
        ],
        world.held_by,
        world.modules,
        world.passed,
    )


@pytest.mark.parametrize(("name", "kind"), one_in(16, SCENARIOS, DETAILS))
def test_equal_states_have_equal_successors(
    name: str, kind: str, request: pytest.FixtureRequest
) -> None:
    (make, number), detail = SCENARIOS[name], DETAILS[kind]
    if not request.node.get_closest_marker("soak"):
        number //= 2
    snapshots = Snapshots()
    views: dict[bytes, object] = {}
    known: dict[bytes, set[bytes]] = {}
    paths: list[tuple[Path, bytes, bytes]] = [((), snapshots.save(Play(make())), b"")]
    merged = 0
    for path, snapshot, key in paths:
        following_here = set()
        for longer, after, reached in successors(
            path, partial(snapshots.load, snapshot), detail, views
        ):
            following_here.add(reached)
            if key not in known and len(paths) < number:
                paths.append((longer, snapshots.save(after), reached))
        merged += key in known
        assert known.setdefault(key, following_here) == following_here, path
    assert merged > number / (10 if detail == Detail() else 20)


@pytest.mark.parametrize("name", SCENARIOS)
def test_explored_world_matches_central(name: str) -> None:
    """The world of properties agrees with central about every task, in random runs."""
    scenario = SCENARIOS[name][0]()
    for seed in range(8):
        played, choices = Play(scenario), Random(seed)
        for _ in range(60):
            actions = played.actions()
            if not actions:
                break
            played.perform(choices.choice(actions))
            assert not played.broken
            living = {task.id: task for task in played.world.tasks if not task.is_over}
            assert living.keys() == played.central.tree.tasks.keys()
            for task in played.central.tree.tasks.values():
                seen = living[task.id]
                attempts = (task.recovery.attempts if task.recovery else 1) + task.retry_pending
                assert (
                    seen.reached,
                    seen.is_suspended,
                    seen.is_killed,
                    seen.is_handled,
                    seen.is_queued,
                ) == (
                    task.reached,
                    task.suspended,
                    bool(task.killed),
                    task.is_running,
                    task.queues is not None,
                ), seen
                assert (seen.attempts, seen.role, seen.body) == (attempts, task.role, task.body), (
                    seen
                )
                failure = "" if task.failure is None or task.is_dealt_with else task.failure[0]
                assert seen.failure == failure, seen


def two_users(
    one: Callable[[Script], object], *, capacity: int = 1
) -> tuple[Scenario, Action, Action]:
    """Return a scenario with two independent users that send a step and a note. Also return the
    first action of each.
    """
    scenario = Scenario("two")
    feet = scenario.module("legs", capacity=capacity)
    feet.handles(STEP)(lambda _: None)
    (feet if capacity > 1 else scenario.module("arm")).handles(NOTE)(lambda _: None)
    scenario.module("one").does(one)
    scenario.module("other").does(lambda me: [me.inform(NOTE)])
    step, note = Play(scenario).actions()
    return scenario, step, note


def fingerprint(play: Play, memories: Iterable[int], detail: Detail = DETAILS["short"]) -> bytes:
    return fingerprint_of(play, memories, detail)[0]


def test_independent_sends_commute_to_one_state() -> None:
    """The order of sends by two independent modules does not matter afterwards."""
    scenario, first, second = two_users(lambda me: [me.command(STEP).wait()])
    ends = {fingerprint(play(scenario, path), ()) for path in ((first, second), (second, first))}
    assert len(ends) == 1


def test_slot_identity_matters_only_with_names() -> None:
    scenario, step, note = two_users(lambda me: [me.command(STEP)], capacity=2)
    ways = [
        (step, note, Action(ActionKind.STEP, "legs/2")),
        (note, step, Action(ActionKind.STEP, "legs/1")),
    ]
    first, second = (play(scenario, way) for way in ways)
    assert [task.is_handled for task in (*first.world.tasks, *second.world.tasks)] == [True, True]
    assert fingerprint(first, ()) == fingerprint(second, ())
    assert fingerprint(first, (), Detail(names=True)) != fingerprint(second, (), Detail(names=True))


def test_age_of_message_matters_only_with_names() -> None:
    scenario, step, note = two_users(lambda me: [me.command(STEP)])
    first, second = play(scenario, (step, note)), play(scenario, (note, step))
    assert fingerprint(first, ()) == fingerprint(second, ())
    assert fingerprint(first, (), Detail(names=True)) != fingerprint(second, (), Detail(names=True))


def test_elapsed_time_matters_only_with_time_detail() -> None:
    scenario = Scenario("two times")
    scenario.module("user").does(
        lambda me: [me.get_variable(Variable("pace", int), me.choose(1, 2))]
    )
    first, second = Play(scenario), Play(scenario)
    second.now = 1.5
    assert fingerprint(first, ()) == fingerprint(second, ())
    assert fingerprint(first, (), Detail(time=True)) != fingerprint(second, (), Detail(time=True))


def test_memories_of_properties_separate_states() -> None:
    played = Play(scenarios.walking())
    assert fingerprint(played, (True,)) != fingerprint(played, (False,))


def test_fingerprint_tables_name_existing_attributes() -> None:
    """A renamed attribute of central would silently become part of the state."""
    central = Central()
    resource, message = ModuleResource("legs", "legs"), central.tree.root.message
    module = Module("legs", "legs", "run", "")
    attached = AttachedHandler(1, "", message, 0, message, "legs")
    things = [
        central,
        central.tree,
        central.registry,
        central.agenda,
        central.agenda.holds,
        central.dispatcher,
        central.tree.root,
        resource,
        central.dispatcher.prefetcher,
        central.dispatcher.lending,
        message,
        module,
        Delivery(1, message, b"", None),
        Connection(ConnectionId(b""), "", module, 0),
        Claim(resource, Connection(ConnectionId(b""), "", module, 0), module, admits_owner=False),
        central.clock,
        central.clock.after(1, Due.TEST, None),
        PendingDelay(central.tree.root, 1, None),  # type: ignore[arg-type]
        Tapping(),
        Watch(central.tree.root, WatchOptions(), []),
        PendingKill(central.tree.root, Scope.TASK, 0, Verdict("")),
        FailureContext(None, None, None, attached, None),  # type: ignore[arg-type]
        attached,
    ]
    assert isinstance(message, MessageType)
    assert isinstance(central.registry, Registry)
    assert isinstance(central.tree, TaskTree)
    by_class = {kind.__name__: thing for thing in things for kind in type(thing).__mro__}
    for kind, names in IGNORED.items():
        assert all(hasattr(by_class[kind], name) for name in names), kind
    assert all(hasattr(by_class[kind], name) for kind, name in SPECIAL)
