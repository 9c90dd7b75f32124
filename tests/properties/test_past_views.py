"""A view of the past equals the view that was recorded then, after every event of a random life."""

from typing import Any

import click
from hypothesis import given, settings
from hypothesis import strategies as st
from properties.folded import FoldedPlayer
from properties.life import Life, Operations, operations
from sampling import lives

from tca_tools.explain.story import story
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.fates import HANDLED
from tca_tools.tasktree_viz.outline import whole_outline
from tca_tools.tasktree_viz.text import tree_lines
from tca_wire.points import MOMENTS, Point, TaskId

FIELDS = (
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
    "suspension",
)
_NO_TIME = 1e-6
"""Seconds: shorter states are not shown."""


def view_at(at: RunAt) -> Any:
    """Return the view at an instant. What follows a failure is excluded, because later facts decide
    it.
    """
    tree = [
        click.unstyle(line).replace(HANDLED, "failed")
        for line in tree_lines(at, whole_outline(at), with_data=True)
    ]
    return (
        [" ".join(line.split()) for line in tree],
        [
            (
                str(task),
                *(str(getattr(task, name)) for name in FIELDS[:6]),
                list(task.caught_by),
                task.constraints,
            )
            for task in at.tasks.values()
        ],
        [at.has_reached(Point(TaskId(task), moment)) for task in at.tasks for moment in MOMENTS],
        {
            place: [one.message_id for one in at.running(*place)]
            for place in at.run.by_resource
            if at.running(*place)
        },
        {place: str(claim) for place in at.run.grants if (claim := at.claim_in_force(*place))},
    )


def stories_at(at: RunAt) -> dict[int, list[str]]:
    """Return the stories of all messages at an instant."""
    known = {number for number, one in at.run.messages.items() if one.received <= at.instant}
    stories = {
        number: [one for one in story(at.run, number, at.instant) if one.time <= at.instant]
        for number in known
    }
    return {
        number: [f"{one.time:.6f} {one.text_at(at.instant, at.instant)}" for one in stories_at]
        for number, stories_at in stories.items()
    }


class WatchedPlayer(FoldedPlayer):
    """A player that folds every entry and records the views."""

    def __init__(self) -> None:
        super().__init__()
        self.view_at: dict[float, tuple[Any, dict[int, list[str]] | None]] = {}

    def compare(self) -> None:
        """Assert that the present view equals the records of the run, and record this view."""
        at, run = RunAt(self.history), self.history
        for task in at.tasks.values():
            assert all(
                getattr(task, name) == getattr(run.tasks[task.id], name) for name in FIELDS
            ), task
            assert bool(task.queueing) == run.tasks[task.id].is_queued
        stories = stories_at(at) if len(run.times) % 3 == 0 else None
        if run.time not in self.view_at:
            self.view_at[run.time] = view_at(at), stories


def check(player: WatchedPlayer) -> None:
    times = player.history.times
    for instant, (recorded, stories) in player.view_at.items():
        at, place = RunAt(player.history, instant), times.index(instant) + 1
        assert view_at(at) == recorded
        if stories is not None and place < len(times) and times[place] - instant > _NO_TIME:
            now = stories_at(at)
            assert {number: now[number] for number in stories} == stories


@given(operations)
@settings(max_examples=lives(15, soak=300))
def test_past_view_matches_view_recorded_then(taken: Operations) -> None:
    player = WatchedPlayer()
    Life(player).live(taken)
    check(player)


@given(st.integers(0, 1 << 32))
@settings(max_examples=1)
def test_past_view_matches_view_recorded_then_in_long_life(seed: int) -> None:
    player = WatchedPlayer()
    Life(player).go_on(seed, 200)
    check(player)
