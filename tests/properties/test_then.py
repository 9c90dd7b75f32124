"""What records that go on say of an earlier moment is what was known then: after every event of a random life."""

from typing import Any

import click
from central.player import Player
from hypothesis import given, settings
from hypothesis import strategies as st
from properties.life import Life, operation

from tca_central.events import Effect, Record
from tca_tools.run.at_time import RunAt
from tca_tools.run.fates import HANDLED
from tca_tools.run.fold import History
from tca_tools.tasktree_viz import words
from tca_tools.tasktree_viz.outline import whole_outline
from tca_tools.tasktree_viz.text import tree_lines
from tca_wire.points import MOMENTS, Point, TaskId


def seen(at: RunAt) -> Any:
    """All that can be seen of a moment."""
    places = [(handling.module, handling.resource) for handling in at.run.handlings]
    places += [place for place, grants in at.run.grants.items() if (grants[0].granted or 0.0) <= at.moment]
    return (
        [_without_verdict(line) for line in tree_lines(at, whole_outline(at), with_data=True)],
        words.summary(at).partition(":")[0],  # what comes then are the states, as below
        [
            (
                str(task),
                task.state,
                task.failure,
                task.why_killed,
                task.body,
                task.result,
                list(task.caught_by),
                task.constraints,
            )
            for task in at.tasks.values()
        ],
        [at.has_reached(Point(TaskId(task), moment)) for task in at.tasks for moment in MOMENTS],
        {place: [handling.message_id for handling in at.running(*place)] for place in places},
        {place: str(at.held_by(*place)) for place in places},
    )


def _without_verdict(line: str) -> str:
    """Whether the run went on after a failure is told as far as the journal goes, also of earlier moments."""
    plain = click.unstyle(line).replace(HANDLED, "failed")
    return " ".join(plain.split())


class WatchedPlayer(Player):
    """Folds every entry, and notes what is seen."""

    def __init__(self) -> None:
        super().__init__(check=False)
        self.history = History()
        self.seen: list[tuple[float, Any]] = []

    def event(self, event: object) -> list[Effect]:
        effects = super().event(event)
        for effect in effects:
            if isinstance(effect, Record):
                self.history.apply(effect.entry)
                self.seen.append((self.history.time, seen(RunAt(self.history))))
                self.check_now()
        return effects

    def check_now(self) -> None:
        """What is known then is, now, what the records say."""
        at = RunAt(self.history)
        assert list(at.tasks) == list(self.history.tasks)
        for task in at.tasks.values():
            record = self.history.tasks[task.id]
            for name in (
                "state",
                "failure",
                "why_killed",
                "body",
                "result",
                "failure_data",
                "caught_by",
                "reached",
                "children",
                "handling",
            ):
                assert getattr(task, name) == getattr(record, name), name
            assert bool(task.queueing) == record.is_queued


def check(player: WatchedPlayer) -> None:
    assert len({time for time, _ in player.seen}) == len(player.seen)
    for time, known in player.seen:
        at = RunAt(player.history, time)
        trees, summary, *rest = seen(at)
        assert (trees, *rest[:2]) == (known[0], *known[2:4])
        assert summary == known[1]
        for now, before in zip(rest[2:], known[4:], strict=True):  # of places that came later nothing was known
            assert {place: now[place] for place in before} == before
            assert not any(one and one != "None" for place, one in now.items() if place not in before)


@given(st.lists(operation, max_size=50))
@settings(max_examples=150)
def test_the_past_is_as_it_was(operations: list[tuple[str, int, int, int, int]]) -> None:
    player = WatchedPlayer()
    life = Life(player)
    for name, *numbers in operations:
        life.do(name, *numbers)
    check(player)


@given(st.integers(0, 1 << 32))
@settings(max_examples=1)
def test_the_past_of_a_longer_life_is_as_it_was(seed: int) -> None:
    player = WatchedPlayer()
    Life(player).go_on(seed, 300)
    check(player)
