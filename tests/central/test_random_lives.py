"""Random lives of central: the invariants hold after every event, and everything ends."""

from central.player import Player, before, point
from hypothesis import given, settings
from hypothesis import strategies as st
from properties.life import LENDING_OPERATIONS, MODULES, Life, Operations, operations
from sampling import lives

from tca_central.model.intervals import unified
from tca_central.model.tasks import Task
from tca_central.order.cycles import NON_MONITORS_ENDED, Place, all_before, successors
from tca_wire.constraints import Constraint, Flags
from tca_wire.journal.facts import Delivered, Killed, Reached, Received
from tca_wire.packets import headers
from tca_wire.points import ROOT, STARTS, Moment, TaskId, start_of


class LendingLife(Life):
    """A life in which handlers also wait for tasks of their own resource, and reply later."""

    operations = LENDING_OPERATIONS


@given(operations)
@settings(max_examples=lives(15, soak=4_000))
def test_invariants_hold_and_everything_ends_in_short_lives(taken: Operations) -> None:
    end_life(Life().live(taken))


@given(st.integers(0, 1 << 32))
@settings(max_examples=lives(1, soak=8))
def test_invariants_hold_and_everything_ends_in_long_lives(seed: int) -> None:
    life = LendingLife()
    life.go_on(seed, lives(600, soak=10_000))
    end_life(life)


@given(st.integers(0, 1 << 32))
@settings(max_examples=1)
def test_predecessors_and_successors_of_points_agree(seed: int) -> None:
    """Cycles are searched from both ends, so both directions must have the same edges."""
    life = Life()
    for number in range(60):
        life.go_on(seed + number, 15)
        tree = life.central.tree
        places = [Place(task, moment) for task in tree.tasks.values() for moment in Moment]
        places += [
            Place(task, NON_MONITORS_ENDED)
            for task in tree.tasks.values()
            if task.background_monitors
        ]
        to_come = {one for one in places if not one.task.reached & one.moment and is_unified(one)}
        ahead = {(one, other) for one in to_come for other in successors(one) if other in to_come}
        behind = {
            (one, other) for other in to_come for one in all_before(tree, other) if one in to_come
        }
        assert ahead == behind


def is_unified(place: Place) -> bool:
    """Whether constraints are attached to this point itself, not to a point that is reached
    together with it.
    """
    return unified(place.task.is_goal, place.moment) == place.moment


def end_life(life: Life) -> None:
    end_everything(life)
    assert not life.central.tree.tasks
    assert not life.central.dispatcher.running
    assert not life.central.collectors
    assert not any(
        connection.outstanding for connection in life.central.registry.connections.values()
    )
    _check_reached_moments(life)
    _check_variable_handlers(life)
    _check_retained_tasks(life)


def end_everything(life: Life) -> None:
    """Add handlers for all messages, and let every handler return. Everything must end, because
    central accepts no cycles.
    """
    for connection in life.connections():
        # Lose whole modules: a module without its slots would keep its deliveries.
        if connection != "user":
            life.player.lose(connection)
    for module in MODULES:
        life.join(module)
    life.player.module("latecomer", "command later")
    for aside in [*life.central.attached, *life.central.taps]:
        life.request(headers.Remove, aside)
    for monitor in life.monitors():
        # All other monitors end with their parents.
        if not monitor.is_background or monitor.parent is life.central.tree.root:
            life.request(headers.Kill, TaskId(monitor.id))
    rounds = 0
    for task in [task for task in life.central.tree.tasks.values() if task.suspended]:
        life.request(headers.Suspend, TaskId(task.id), True)
    while life.central.dispatcher.running or life.central.clock.next is not None:
        life.reply_(0)
        life.pass_(9)
        rounds += 1
        assert rounds < 5000
    assert not life.central.tree.tasks, [stuck(task) for task in life.central.tree.tasks.values()]


def stuck(task: Task) -> str:
    return f"{task} {task.reached} held {task.held} {task.children and list(task.children)}"


def _check_reached_moments(life: Life) -> None:
    """Check that each task reached each moment once, and met all its constraints. A delay after an
    interval that a killed task never began is not kept.
    """
    reached: dict[tuple[int, int], int] = {}
    never_began: dict[int, int] = {}  #: by killed task
    constraints: list[Constraint] = []
    order = 0
    times: dict[tuple[int, int], float] = {}
    for entry in life.player.entries:
        for fact in entry.facts:
            if isinstance(fact, Received):
                constraints += fact.constraints
            elif fact.__struct_config__.tag == "constrained":
                constraints += fact.constraints  # type: ignore[union-attr]
            elif isinstance(fact, Killed):
                begun = sum(moment for moment in Moment if (fact.task, moment) in reached)
                never_began[int(fact.task)] = STARTS & ~begun
            elif isinstance(fact, Reached):
                order += 1
                for moment in Moment:
                    if fact.moments & moment:
                        assert (fact.task, moment) not in reached
                        reached[fact.task, moment] = order
                        times[fact.task, moment] = entry.time
    for constraint in constraints:
        if constraint.after.task not in never_began:
            one, other = constraint.before, constraint.after
            if one.task != ROOT:
                assert reached[one.task, one.moment] <= reached[other.task, other.moment], (
                    constraint
                )
            is_void = never_began.get(one.task, 0) & start_of(one.moment)
            assert (
                times.get((one.task, one.moment), 0.0) + (0 if is_void else constraint.delay)
                <= times[other.task, other.moment]
            )


def _check_retained_tasks(life: Life) -> None:
    """Check that retained tasks report their outcomes, and are forgotten after the last release."""
    for record in life.central.memory.records.values():
        life.request(headers.AwaitPoint, point(TaskId(record.id), Moment.END_ACHIEVING))
        answer, _ = life.player.inbox["user"][-1]
        assert answer.outcome is record.outcome[0]
    for connection in life.connections():
        life.player.lose(connection)
    assert not life.central.memory.records
    assert not life.central.memory.retentions
    assert not life.central.memory.record_bytes


def _check_variable_handlers(life: Life) -> None:
    """Check for each handler of a variable that the newest value was delivered to it last."""
    value = life.central.variables.values.get("mode")
    newest = {
        fact.module: fact.message_id
        for fact in life.player.facts(Delivered)
        if fact.id in life.copies_of("mode")
    }
    for handler in life.central.registry.messages["mode"].handlers:
        assert newest.get(handler.module.name) == (value.message_id if value else None)


def test_delay_after_a_start_that_never_came_is_not_required() -> None:
    life, player = Life(), Player()
    life.player = player
    player.module("user")
    player.module("legs", "command move")
    unbegun = player.task("user", "move", suspended=True)
    delay = before(point(unbegun, Moment.START_HANDLING), point(-1, Moment.START_ACHIEVING), 60)
    player.task("user", "move", flags=Flags.NONE, constraints=(delay,))
    player.request("user", headers.Kill, TaskId(unbegun))
    player.reply("legs/1")
    _check_reached_moments(life)


def test_deep_and_wide_trees_end_without_recursion() -> None:
    for depth, width in ((1200, 1), (1, 1200)):
        player = Player(check=False)
        player.module("planner", "goal walk", capacity=1)
        player.module("user")
        parent = player.task("user", "walk")
        top = parent
        for _ in range(max(depth, width)):
            child = player.task("user", "walk", under=parent, flags=Flags.NONE)
            parent = child if depth > 1 else top
        while player.central.dispatcher.running:
            player.reply("planner/1")
        assert not player.central.tree.tasks
