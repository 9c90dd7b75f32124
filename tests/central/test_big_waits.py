"""Handlers that wait for a goal with thousands of subtasks: no event looks at more than so many edges of the graph of who
waits for whom, an idle wait costs nothing, and a circle behind all that is found all the same.
"""

from typing import Any

import pytest
from central.player import IN_PYTHON, Player, point

from tca_central.deadlock import deadlocks
from tca_central.deadlock.search import Search
from tca_central.events import Effect
from tca_wire.constraints import Flags
from tca_wire.journal.facts import RequestRefused
from tca_wire.packets import headers
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import Refusal

WIDE = 3_000
MOST = deadlocks.PATIENCE + deadlocks.SLICE + 10
"""A wait may begin in an event in which a look is due. A group is looked at as a whole, so that it may be a few more."""


class Crowd(Player):
    """A goal with thousands of commands, all of which wait for busy legs."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        super().__init__(check=False)
        self.most = self.edges = 0  #: edges looked at in one event, and in this one
        count = Search._count

        def counted(search: Search, edges: int) -> None:
            self.edges += edges
            count(search, edges)

        monkeypatch.setattr(Search, "_count", counted)
        self.module("planner", "goal walk")
        self.module("legs", "command move")
        self.module("watcher", "query done", "command note", capacity=2)
        self.module("map", "query where")
        self.module("user")
        self.walk = self.task("user", "walk")
        for _ in range(WIDE):
            self.task("planner", "move", under=self.walk, flags=Flags.NONE)

    def event(self, event: Any) -> list[Effect]:
        self.edges = 0
        effects = super().event(event)
        self.most = max(self.most, self.edges)
        return effects

    def wait(self, who: str, origin: int = 0) -> None:
        end = point(TaskId(self.walk), Moment.END_ACHIEVING)
        self.receive(who, headers.AwaitPoint(self.number(who), end, origin, blocking=True))

    def ask(self) -> int:
        """Ask whether it is done; the handler's delivery."""
        self.send("user", "done")
        return next(reversed(self.central.dispatcher.running))

    def look_to_the_end(self) -> int:
        """How many looks that takes."""
        looks = 0
        while self.central.next_look is not None:
            self.tick(0.25)
            looks += 1
        return looks

    @property
    def refused(self) -> list[str]:
        return [fact.text for fact in self.facts(RequestRefused) if fact.refusal is Refusal.DEADLOCK]


@pytest.fixture
def crowd(monkeypatch: pytest.MonkeyPatch) -> Crowd:
    return Crowd(monkeypatch)


def test_the_wait_of_a_client_for_a_wide_goal_costs_nothing(crowd: Crowd) -> None:
    crowd.wait("user")
    crowd.look_to_the_end()
    assert crowd.most <= 1


@IN_PYTHON
def test_no_event_looks_at_more_than_so_many_edges(crowd: Crowd) -> None:
    """And once all is known to go on, nothing is looked at before something happens that might change that."""
    for slot in ("watcher/1", "watcher/2"):
        crowd.wait(slot, crowd.ask())
    assert crowd.look_to_the_end() > 1
    assert 0 < crowd.most <= MOST
    crowd.send("user", "where")
    crowd.reply("map/1", next(reversed(crowd.central.dispatcher.running)))
    assert crowd.central.next_look is None, "a question of strangers closes no circle"
    crowd.task("user", "walk")
    assert crowd.central.next_look is not None, "a task might"


def test_a_circle_behind_thousands_of_subtasks_is_found_in_the_end(crowd: Crowd) -> None:
    note = crowd.task("planner", "note", under=crowd.walk, flags=Flags.NONE)
    crowd.reply("watcher/1", note)
    both = [crowd.ask(), crowd.ask()]
    crowd.task("planner", "note", under=crowd.walk, flags=Flags.NONE)  # for a watcher, and both wait for the walk
    for delivery in both:
        slot = crowd.central.dispatcher.running[delivery].slot
        assert slot is not None
        crowd.wait(slot.id.decode(), delivery)
    assert not crowd.refused, "that takes longer than an event may"
    crowd.look_to_the_end()
    assert crowd.most <= MOST
    (text,) = crowd.refused
    assert text.endswith("waits for watcher, busy with done {3004} and done {3003}")


def test_a_circle_that_comes_undone_while_it_is_looked_for_is_none(crowd: Crowd) -> None:
    both = [crowd.ask(), crowd.ask()]
    crowd.task("planner", "note", under=crowd.walk, flags=Flags.NONE)
    for delivery in both:
        slot = crowd.central.dispatcher.running[delivery].slot
        assert slot is not None
        crowd.wait(slot.id.decode(), delivery)
    crowd.tick(0.25)
    assert crowd.central.scan is not None
    waiter = next(iter(crowd.central.blocked))
    crowd.receive(waiter.id.decode(), headers.GiveUp(next(iter(waiter.waits))))
    crowd.look_to_the_end()
    assert not crowd.refused
