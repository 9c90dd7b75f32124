"""A row says for how long its cause has been one: as long as the story's sentence has gone on, at any moment; or longer
where another cause was one meanwhile. Compared with what the causes were at each moment before.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from itertools import pairwise, takewhile
from math import nextafter

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from properties.folded import FoldedPlayer
from properties.life import Life, operation
from properties.test_blocked_is_told import blocking, steps
from properties.test_causes_in_stories import life_of

from tca_tools.run.at_time import RunAt, TaskAt
from tca_tools.run.records import State
from tca_tools.run.whole_run import Run
from tca_tools.why.ages import age
from tca_tools.why.story import Sentence, story
from tca_tools.why.waiting import Until, reasons_of, waits_since, why_waiting
from tca_tools.why.whereabouts import kept_busy
from tca_wire.points import TaskId
from tca_wire.text.facts_in_words import place

_NO_TIME = 1e-6
"""Seconds: of what lasts no longer nothing is told."""
_BACK = 40
"""Moments before that are looked at."""
_LOOKS = 12
"""Moments of a run that are looked at."""
_TOLD = (State.HELD, State.PLANNED, State.ACHIEVING, State.ENDING, State.RECOVERING)
"""States of which a story tells with the reasons."""


def assert_ages_are_the_story_s(run: Run, looks: int = _LOOKS) -> int:
    """Between any two entries, of each task that waits. Returns how many causes were compared."""
    moments = [(before, after) for before, after in pairwise([*run.times, run.time]) if after - before > _NO_TIME]
    compared = 0
    for before, after in moments[:: max(len(moments) // looks, 1)]:
        at = RunAt(run, nextafter(after, before))
        for number, task in at.tasks.items():
            known = [one for one in story(run, number, at.moment) if _goes_on(one, at.moment)]
            assert_it_waits_in_all_since(at, task)
            for text, since in _told(at, task):
                found = [one for one in known if one.text.removesuffix(one.ending) == text]
                for one in found[-1:]:
                    compared += 1
                    if task.state in _TOLD and not task.watches:
                        assert since is None or since <= one.time + _NO_TIME, (at.moment, text, one)
                        assert_it_was_so_since(at, task, since)
                    else:
                        assert since == pytest.approx(one.time, abs=_NO_TIME), (at.moment, text, one)
    return compared


def assert_it_waits_in_all_since(at: RunAt, task: TaskAt) -> None:
    """Before that it was in another state; since then in none but that and suspended."""
    if task.handling or task.watches or task.state not in _TOLD[:3]:
        return
    states = [one for one in at.run.tasks[task.id].states if one[0] <= at.moment]
    lately = list(takewhile(lambda one: one[1] in (task.state, State.SUSPENDED), reversed(states)))
    assert age(at, task).begun == min(time for time, state in lately if state is task.state), (at.moment, task.id)


def assert_it_was_so_since(at: RunAt, task: TaskAt, since: float | None) -> None:
    """All that it waits for now, it did at each moment since, and not before."""
    if since is None:
        return
    times = at.run.times
    first, begun = bisect_left(times, since), waits_since(task)
    for time in times[first : bisect_right(times, at.moment)][:_BACK]:
        if time - since > _NO_TIME:
            assert _waited_for_as_much(RunAt(at.run, time), at, task), (at.moment, since, time)
    if since - begun > _NO_TIME:
        assert not _waited_for_as_much(RunAt(at.run, nextafter(since - _NO_TIME, begun)), at, task), (at, since)


def _waited_for_as_much(before: RunAt, at: RunAt, task: TaskAt) -> bool:
    was, number = before.tasks[task.id], TaskId(task.id)
    reasons, once = (set(_singly(one, number)) for one in (at, before))
    return reasons <= once and was.state in _TOLD


def _singly(at: RunAt, number: TaskId) -> Iterator[tuple[str, int]]:
    """Each that it waits for, and until what; however that ends, if the task is to be handled again then."""
    for reason in reasons_of(at, number):
        if isinstance(reason, Until):
            what = "is achieved" if reason.what == "has ended" else reason.what
            yield from ((what, one) for one in reason.tasks)
        else:
            yield reason, 0


def _told(at: RunAt, task: TaskAt) -> list[tuple[str, float | None]]:
    """What the story has to say of what a task waits for, and since when it does by its row."""
    reasons = why_waiting(at, TaskId(task.id))
    if not reasons:
        return []
    since = age(at, task).since
    if task.state in _TOLD and not task.watches:
        return [(f"{task.state}, {' and '.join(reasons)}", since)]
    if task.state is State.QUEUED and (queueing := task.queueing) and queueing.module:
        why = kept_busy(at, queueing.module, queueing.resource, task)
        return [(f"queued for {place(queueing.module, queueing.resource)}" + (f", {why}" if why else ""), since)]
    if task.handling and [wait.awaited in at.run.claims for wait in task.waits] == [True]:
        return [(f"its handler waits {reasons[0]}", since)]
    return []


def _goes_on(one: Sentence, moment: float) -> bool:
    return one.time <= moment and (one.is_open or moment < one.time + (one.seconds or 0.0))


@given(st.lists(operation, max_size=50))
@settings(max_examples=30)
def test_a_row_says_for_how_long_its_cause_has_been_one(operations: list[tuple[str, int, int, int, int]]) -> None:
    assert_ages_are_the_story_s(life_of(operations))


@given(steps)
@settings(max_examples=30)
def test_so_do_rows_of_handlers_that_block(taken: list[tuple[str, int, int, int]]) -> None:
    assert_ages_are_the_story_s(blocking(taken).history)


def test_many_rows_are_compared() -> None:
    player = FoldedPlayer()
    Life(player).go_on(0, 400)
    assert assert_ages_are_the_story_s(player.history, 60) > 50


@pytest.mark.soak
@given(st.integers(0, 1 << 32))
@settings(max_examples=150)
def test_so_do_rows_of_many_lives(seed: int) -> None:
    player = FoldedPlayer()
    Life(player).go_on(seed, 300)
    assert_ages_are_the_story_s(player.history, 60)


@pytest.mark.soak
@given(steps)
@settings(max_examples=1_000)
def test_so_do_rows_of_many_handlers_that_block(taken: list[tuple[str, int, int, int]]) -> None:
    test_so_do_rows_of_handlers_that_block.hypothesis.inner_test(taken)  # type: ignore[attr-defined]
