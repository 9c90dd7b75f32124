"""A story names a cause for as long as it was the cause: at any moment it names what was known to be it then."""

from bisect import bisect_right
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from properties.folded import FoldedPlayer
from properties.life import Life, operation
from properties.test_blocked_is_told import blocking, steps
from tools.test_story import waiting_for_many

from tca_tools.run.at_time import RunAt, TaskAt
from tca_tools.run.fold import History
from tca_tools.run.records import OVER, State
from tca_tools.run.whole_run import Run
from tca_tools.why.story import Sentence, story
from tca_tools.why.stretches import in_state
from tca_tools.why.waiting import Reason, Until, reasons_of, why_waiting
from tca_tools.why.whereabouts import NAMED, kept_busy
from tca_wire.points import TaskId
from tca_wire.text.facts_in_words import place

_NO_TIME = 1e-6
"""Seconds: of what lasts no longer nothing is told."""
_LOOKS = 40
"""Moments of a run that are looked at."""


def assert_names_causes(run: Run, looks: int = _LOOKS) -> None:
    """Between any two entries, in the middle, each story names what was known to be the cause there."""
    moments = [(before, after) for before, after in pairwise([*run.times, run.time]) if after - before > _NO_TIME]
    stories = {number: story(run, number) for number in run.messages}
    for before, after in moments[:: max(len(moments) // looks, 1)]:
        at = RunAt(run, (before + after) / 2)
        for number, told in stories.items():
            if run.messages[number].received <= at.moment:
                _assert_names_cause(at, number, told)


def _assert_names_cause(at: RunAt, number: int, told: list[Sentence]) -> None:
    known = [one.text.removesuffix(one.ending) for one in told if _goes_on(one, at.moment)]
    for text in _causes(at, number):
        is_between = any(one.endswith(", one after the other") for one in known)
        assert text in known or is_between or _is_of_many(at, number), (
            f"message {number} at {at.moment}: {text!r} not in {known}"
        )


def _is_of_many(at: RunAt, number: int) -> bool:
    """Whether what it waits for are many tasks of which a stretch tells that began with more, and as one."""
    task = at.run.tasks[TaskId(number)]
    reasons = reasons_of(at, TaskId(number))
    left = {one for reason in reasons if isinstance(reason, Until) for one in reason.tasks}
    place = bisect_right(task.states, at.moment, key=lambda one: one[0]) - 1
    parts = in_state(at.run, task, place)
    (part,) = (one for one in parts if one.start <= at.moment and (one.end is None or at.moment < one.end))
    before = reasons_of(RunAt(at.run, part.start), TaskId(number))
    return len(left) > NAMED and left < part.tasks and list(map(_kind, before)) == list(map(_kind, reasons))


def _kind(reason: Reason) -> str:
    return reason.what if isinstance(reason, Until) else reason


def _goes_on(one: Sentence, moment: float) -> bool:
    return one.time <= moment and (one.is_open or moment < one.time + (one.seconds or 0.0))


def _causes(at: RunAt, number: int) -> list[str]:
    """What a story has to say of what a message waits for."""
    message = at.run.messages[number]
    found = []
    queueing = at.queueing_of(message)
    if queueing is not None and queueing.module:
        why = kept_busy(at, queueing.module, queueing.resource, message)
        found.append(f"queued for {place(queueing.module, queueing.resource)}" + (f", {why}" if why else ""))
    task = at.tasks.get(number)
    if task is None:
        return found
    reasons = why_waiting(at, TaskId(number))
    if task.state not in OVER and not task.watches and _is_of_state(task) and reasons and _lasts(at, number):
        found.append(f"{task.state}, {' and '.join(reasons)}")
    run = task.handling
    waits = at.waits_of(run) if run else []
    locks = [one for one in waits if one.awaited in at.run.claims]
    granted = [at.run.claims[one.awaited].granted == one.start for one in locks]
    if task.state in (State.HANDLING, State.PLANNING) and len(waits) == len(locks) == 1 and not granted[0]:
        found.append(f"its handler waits {reasons[0]}")
    return found


def _is_of_state(task: TaskAt) -> bool:
    return task.state in (State.HELD, State.PLANNED, State.ACHIEVING, State.RECOVERING, State.ENDING)


def _lasts(at: RunAt, number: int) -> bool:
    """Whether it is for long in its state."""
    states = at.run.tasks[number].states
    after = bisect_right(states, at.moment, key=lambda one: one[0])
    return after == len(states) or states[after][0] - states[after - 1][0] >= _NO_TIME


def life_of(operations: list[tuple[str, int, int, int, int]]) -> History:
    player = FoldedPlayer()
    life = Life(player)
    for name, *numbers in operations:
        life.do(name, *numbers)
    return player.history


def test_so_it_does_of_what_waits_for_many() -> None:
    assert_names_causes(waiting_for_many().fold())


@given(st.lists(operation, max_size=50))
@settings(max_examples=60)
def test_a_story_names_each_cause_for_as_long_as_it_was_one(operations: list[tuple[str, int, int, int, int]]) -> None:
    assert_names_causes(life_of(operations))


@given(steps)
@settings(max_examples=60)
def test_so_it_does_of_handlers_that_block(taken: list[tuple[str, int, int, int]]) -> None:
    assert_names_causes(blocking(taken).history)


@given(st.integers(0, 1 << 32))
@settings(max_examples=2)
def test_so_it_does_in_a_longer_life(seed: int) -> None:
    player = FoldedPlayer()
    Life(player).go_on(seed, 200)
    assert_names_causes(player.history)


@pytest.mark.soak
@given(st.integers(0, 1 << 32))
@settings(max_examples=150)
def test_so_it_does_in_many_lives(seed: int) -> None:
    player = FoldedPlayer()
    Life(player).go_on(seed, 300)
    assert_names_causes(player.history, 100)


@pytest.mark.soak
@given(steps)
@settings(max_examples=2_000)
def test_so_it_does_of_many_handlers_that_block(taken: list[tuple[str, int, int, int]]) -> None:
    test_so_it_does_of_handlers_that_block.hypothesis.inner_test(taken)  # type: ignore[attr-defined]
