"""The search for cycles skips the descendants of most tasks, and still finds every path.

SubtreesToEnter are the tasks whose subtrees a search must enter.
"""

import random
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import pytest
from central.player import IN_PYTHON, INTEGER, Player, before, point
from hypothesis import given, settings
from hypothesis import strategies as st
from properties.life import Life
from sampling import lives

from tca_central.deadlock import deadlocks
from tca_central.deadlock.search import Search
from tca_central.events import Effect
from tca_central.model.intervals import unified
from tca_central.model.task_tree import TaskTree
from tca_central.model.tasks import Task
from tca_central.order import cycles
from tca_central.order.cycles import PathSearch, Place, SubtreesToEnter, find_path, successors
from tca_wire.constraints import Flags
from tca_wire.journal.facts import RequestRefused
from tca_wire.packets import headers
from tca_wire.packets.parts import Attachment, MessageFormat, WatchOptions
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import MessageClass, Refusal, Role

END, START = Moment.END_ACHIEVING, Moment.START_ACHIEVING


@given(st.integers(0, 1 << 32))
@settings(max_examples=lives(1, soak=200))
def test_cycle_search_agrees_with_unpruned_search(seed: int) -> None:
    """The trees have constraints between subtrees, retries, kills and ended tasks."""
    life, chance = Life(), random.Random(seed)
    for number in range(lives(40, soak=60)):
        life.go_on(seed + number, 12)
        compare(life.central.tree, chance)


@given(st.integers(0, 1 << 32))
@settings(max_examples=2)
def test_cycle_search_agrees_with_unpruned_search_before_starts(seed: int) -> None:
    chance = random.Random(seed)
    player = planned_ahead(chance)
    for _ in range(12):
        one, other = chance.choices(sorted(player.central.tree.tasks) or [TaskId(1)], k=2)
        wanted = before(
            point(one, chance.choice(list(Moment))), point(other, chance.choice(list(Moment)))
        )
        player.request("user", headers.Constrain, [wanted])
        if chance.random() < 0.1:
            player.request("user", headers.Kill, TaskId(one))
        compare(player.central.tree, chance)


def planned_ahead(chance: random.Random) -> Player:
    """Return a player with a random tree of goals and commands. All tasks are held; some goals have
    been handled already.
    """
    player = Player(check=False)
    player.module("planner", "goal walk", capacity=3)
    player.module("user")
    player.declare("user", "goal walk", "command move")
    held = before(point(player.task("user", "move"), END), point(-1, START))
    for _ in range(chance.randint(5, 25)):
        goals = [one.id for one in player.central.tree.tasks.values() if one.is_goal]
        parent = chance.choice([0, *goals])
        flags = Flags(chance.choice([0, 0, 1, chance.randrange(16)]))
        message = chance.choice(["walk", "walk", "move"])
        player.send(
            "user",
            message,
            under=parent,
            origin=0,
            flags=flags,
            constraints=(held,) if not parent else (),
        )
        for slot in ("planner/1", "planner/2", "planner/3"):
            if chance.random() < 0.3 and player.delivered(slot):
                player.reply(slot)
    return player


def compare(tree: TaskTree, chance: random.Random) -> None:
    """Search for paths between random pending points in all three ways, and compare whether each
    way finds one.
    """
    places = [
        place
        for place in all_places(tree)
        if unified(place.task.is_goal, place.moment) == place.moment
    ]
    for _ in range(min(150, len(places) ** 2)):
        start, goal = chance.choice(places), chance.choice(places)
        if start != goal:
            known = path_of(PathSearch(tree, start, goal))
            assert (
                (known is None)
                == (pruned(tree, start, goal) is None)
                == (found_by_central(tree, start, goal) is None)
            )


def all_places(tree: TaskTree) -> Iterator[Place]:
    for task in tree.tasks.values():
        yield from (Place(task, int(moment)) for moment in Moment if not task.reached & moment)


def path_of(search: PathSearch) -> list[Place] | None:
    while not search.step():
        pass
    return search.path


def pruned(tree: TaskTree, start: Place, goal: Place) -> list[Place] | None:
    borders = SubtreesToEnter(start, goal)
    for _ in borders.collect(tree):
        pass
    return checked(path_of(PathSearch(tree, start, goal, borders)), start, goal)


def found_by_central(tree: TaskTree, start: Place, goal: Place) -> list[Place] | None:
    """Search as central does, but with borders from the first step."""
    easy, cycles.EASY_ROUNDS = cycles.EASY_ROUNDS, 0
    try:
        return checked(find_path(tree, start, goal), start, goal)
    finally:
        cycles.EASY_ROUNDS = easy


def checked(path: list[Place] | None, start: Place, goal: Place) -> list[Place] | None:
    """Check that each step of a path leads to a pending successor."""
    if path is not None:
        assert (path[0], path[-1]) == (start, goal)
        for one, other in pairwise(path):
            assert other in successors(one)
            assert not other.task.reached & other.moment
    return path


def test_path_from_recovery_to_retried_ancestor_is_found() -> None:
    """The failing task has not begun. The path leaves the task's subtree for a distant ancestor."""
    player = Player.of(
        "planner: goal walk", "eye: query seen", "expert: exception handler recover", "user"
    )
    player.declare("user", "goal walk", "command move")
    watch = MessageFormat("watch", MessageClass.POLLING_MONITOR, INTEGER, "", ["seen", "move"])
    player.request("user", headers.Register, [watch])
    walk = player.task("user", "walk", attachments=[Attachment("slip", "recover")])
    monitor = player.task(
        "user", "watch", under=walk, origin=0, watch=WatchOptions(7)
    )  # another module sends it, so a retry spares it
    first = player.task("user", "move", flags=Flags.NONE)
    held = before(point(first, END), point(-1, Moment.START_PLANNING))
    goal = player.task("user", "walk", under=monitor, origin=0, constraints=(held,))
    step = goal
    for _ in range(10):  # these tasks make the search from the other end slow
        step = player.task("user", "walk", under=step, origin=0)
    player.request("user", headers.Raise, TaskId(goal), "slip")
    tasks = player.central.tree.tasks
    (handler,) = (task for task in tasks.values() if task.role is Role.EXCEPTION)
    player.request("expert/1", headers.Retry, TaskId(walk))
    wanted = before(point(step, END), point(handler.id, END))
    player.request("user", headers.Constrain, [wanted])
    start, end = (
        Place(tasks[TaskId(goal)], Moment.START_PLANNING),
        Place(tasks[TaskId(walk)], Moment.END_HANDLING),
    )
    assert pruned(player.central.tree, start, end)


# --- costs ----------------------------------------------------------------------------------------

WIDE = 1_500


class CountedSearch:
    """A central whose search steps are counted."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.steps = 0
        self.player = player = Player(check=False)
        player.module("planner", "goal walk", capacity=4)
        player.module("user")
        player.declare("user", "goal walk", "command move")
        for kind, name in ((PathSearch, "step"), (SubtreesToEnter, "collect")):
            self._count(monkeypatch, kind, name)

    def _count(self, monkeypatch: pytest.MonkeyPatch, kind: type, name: str) -> None:
        original = getattr(kind, name)

        def step(search: PathSearch) -> bool:
            self.steps += 1
            return bool(original(search))

        def draw(borders: SubtreesToEnter, tree: TaskTree) -> Iterator[None]:
            for _ in original(borders, tree):
                self.steps += 1
                yield

        monkeypatch.setattr(kind, name, step if kind is PathSearch else draw)

    def wide(self, **options: object) -> int:
        """Send a goal that is planned ahead, with thousands of subtasks."""
        goal = self.player.task("user", "walk", flags=Flags.NONE, **options)
        for _ in range(WIDE):
            self.player.task("user", "move", under=goal, origin=0, flags=Flags.NONE)
        return goal

    def plan(self) -> None:
        """Let all handlers return."""
        for slot in ("planner/1", "planner/2"):
            self.player.reply(slot)

    def constrain(self, one: int, other: int) -> list[object]:
        self.steps = 0
        wanted = before(point(one, END), point(other, START))
        return self.player.request("user", headers.Constrain, [wanted])


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> CountedSearch:
    return CountedSearch(monkeypatch)


@pytest.mark.parametrize("planned", [True, False])
def test_constraint_between_wide_goals_costs_few_steps(
    counted: CountedSearch, planned: bool
) -> None:
    first = counted.player.task("user", "move")
    held = (before(point(first, END), point(-1, START)),)
    one, other = (counted.wide(constraints=held) for _ in range(2))
    if planned:
        counted.plan()
    (answer,) = counted.constrain(one, other)
    assert isinstance(answer, headers.Accepted)
    assert counted.steps < 60
    (answer,) = counted.constrain(other, one)
    assert isinstance(answer, headers.Refused)
    assert counted.steps < 60


def test_constraint_costs_few_steps_when_subtasks_wait_outside(counted: CountedSearch) -> None:
    """The constraints lead from outside into the subtree of each goal, but not out of it."""
    first = counted.player.task("user", "move")
    held = (before(point(first, END), point(-1, START)),)
    one, other = (counted.wide(constraints=held) for _ in range(2))
    for goal in (one, other):
        counted.player.task("user", "move", under=goal, origin=0, constraints=held)
    counted.plan()
    (answer,) = counted.constrain(one, other)
    assert isinstance(answer, headers.Accepted)
    assert counted.steps < 80


def test_cycle_with_top_of_deep_tree_is_found_in_few_steps(counted: CountedSearch) -> None:
    top = task = counted.player.task("user", "walk")
    for _ in range(WIDE):
        task = counted.player.task("user", "walk", under=task, origin=0)
    (answer,) = counted.constrain(top, task)
    assert isinstance(answer, headers.Refused)
    assert f"end achieving task {top}" in answer.text
    assert counted.steps < 60


def test_killed_task_leaves_the_index_of_cross_tree_constraints(counted: CountedSearch) -> None:
    """The index would otherwise keep ended tasks alive."""
    goal = counted.player.task("user", "walk")
    inner = counted.player.task("user", "move", under=goal, origin=0)
    counted.player.task("user", "move", constraints=(before(point(inner, END), point(-1, START)),))
    tree = counted.player.central.tree
    crossing: list[Task] = list(tree.crossing_leaders)
    assert [one.id for one in crossing] == [inner]
    counted.player.request("user", headers.Kill, TaskId(inner))
    assert not tree.crossing_leaders


# --- handlers that wait for a goal with thousands of subtasks: the work of one event is bounded ---

SUBTASKS = 3_000
MOST = deadlocks.PATIENCE + deadlocks.SLICE + 10
"""The greatest number of edges that one event may examine. The event may begin a wait and continue
a search. A few edges more are allowed, because a group is examined as a whole.
"""


class Crowd(Player):
    """A player with a goal whose thousands of commands wait for busy legs."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        super().__init__(check=False)
        self.most = self.edges = 0  #: the most edges examined in one event, and those in this event
        count = Search._count

        def counted(search: Search, edges: int) -> None:
            self.edges += edges
            count(search, edges)

        monkeypatch.setattr(Search, "_count", counted)
        self.module("planner", "goal walk")
        self.module("legs", "command move")
        self.module("watcher", "query done", "command note", capacity=2)
        self.module("map", "query where")
        self.module("gate", "command cross")
        self.module("user")
        self.walk = self.task("user", "walk")
        for _ in range(SUBTASKS):
            self.task("planner", "move", under=self.walk, flags=Flags.NONE)

    def event(self, event: Any) -> list[Effect]:
        self.edges = 0
        effects = super().event(event)
        self.most = max(self.most, self.edges)
        return effects

    def wait(self, connection: str, origin: int = 0) -> None:
        end = point(TaskId(self.walk), Moment.END_ACHIEVING)
        self.request(connection, headers.AwaitPoint, end, origin, blocking=True)

    def ask_below(self) -> None:
        """Send a subtask of the walk, whose handler asks the watchers."""
        crossing = self.task("planner", "cross", under=self.walk, flags=Flags.NONE)
        self.send("gate/1", "done", origin=crossing, blocking=True)

    def ask(self) -> int:
        """Send a query. Return the delivery of its handler."""
        self.send("user", "done")
        return next(reversed(self.central.dispatcher.running))

    def finish_search(self) -> int:
        """Let the deadlock search end. Return the number of its slices."""
        slices = 0
        while self.central.search_timer is not None:
            self.tick(0.25)
            slices += 1
        return slices

    @property
    def refused(self) -> list[str]:
        return [
            fact.text for fact in self.facts(RequestRefused) if fact.refusal is Refusal.DEADLOCK
        ]


@pytest.fixture
def crowd(monkeypatch: pytest.MonkeyPatch) -> Crowd:
    return Crowd(monkeypatch)


def test_client_wait_for_wide_goal_examines_at_most_one_edge(crowd: Crowd) -> None:
    crowd.wait("user")
    crowd.finish_search()
    assert crowd.most <= 1


@IN_PYTHON
def test_deadlock_search_examines_bounded_edges_per_event(crowd: Crowd) -> None:
    """After a search without result, the next one starts only with an event that may close a
    cycle.
    """
    for slot in ("watcher/1", "watcher/2"):
        crowd.wait(slot, crowd.ask())
    assert crowd.finish_search() > 1
    assert 0 < crowd.most <= MOST
    crowd.send("user", "where")
    crowd.reply("map/1", next(reversed(crowd.central.dispatcher.running)))
    assert crowd.central.search_timer is None, "a query of other modules closes no cycle"
    crowd.task("user", "walk")
    assert crowd.central.search_timer is not None, "a task may close one"


def test_deadlock_behind_thousands_of_subtasks_is_found(crowd: Crowd) -> None:
    both = [crowd.ask(), crowd.ask()]
    crowd.ask_below()
    for delivery in both:
        slot = crowd.central.dispatcher.running[delivery].slot
        assert slot is not None
        crowd.wait(slot.id.decode(), delivery)
    assert not crowd.refused, "the search takes more than one event"
    crowd.finish_search()
    assert crowd.most <= MOST
    (text,) = crowd.refused
    assert "{3005}" in text


def test_slot_that_waits_behind_thousands_of_subtasks_is_lent(crowd: Crowd) -> None:
    both = [crowd.ask(), crowd.ask()]
    note = crowd.task("planner", "note", under=crowd.walk, flags=Flags.NONE)
    for delivery in both:
        slot = crowd.central.dispatcher.running[delivery].slot
        assert slot is not None
        crowd.wait(slot.id.decode(), delivery)
    crowd.finish_search()
    assert crowd.most <= MOST
    assert not crowd.refused
    assert crowd.central.tree.tasks[note].nested


def test_deadlock_resolved_during_search_is_not_reported(crowd: Crowd) -> None:
    both = [crowd.ask(), crowd.ask()]
    crowd.ask_below()
    for delivery in both:
        slot = crowd.central.dispatcher.running[delivery].slot
        assert slot is not None
        crowd.wait(slot.id.decode(), delivery)
    crowd.tick(0.25)
    assert crowd.central.scan is not None
    waiter = next(iter(crowd.central.blocked))
    crowd.receive(waiter.id.decode(), headers.GiveUp(next(iter(waiter.waits))))
    crowd.finish_search()
    assert not crowd.refused
