"""No cause comes later than its effect: nobody is told of a failure after he gave up or ended, and nothing fails of what
failed later; in stories, in chains of failures, and in what is said to have become of failures.
"""

import re
from math import inf

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from properties.folded import FoldedPlayer
from properties.life import Life, operation
from properties.test_blocked_is_told import Told, steps

from tca_central.events import Effect, Record
from tca_tools.analysis.failures import failures
from tca_tools.run.at_time import RunAt
from tca_tools.run.fates import UNDECIDED, Failing, Fate, failing, fate, is_told, told_to, went_on
from tca_tools.run.records import Handling, Message, Task
from tca_tools.run.whole_run import Run
from tca_tools.tasktree_viz.failing import Link, failure_chain
from tca_tools.why.story import story
from tca_wire.journal import facts
from tca_wire.points import TaskId
from tca_wire.vocabulary import MessageClass, Outcome, Role

_NUMBER = re.compile(r"\{(\d+)\}")
_FAILED = re.compile(r"[^{]*\{(\d+)\} failed: ")
_STANDS = re.compile(r"exception handler [^{]*\{(?P<number>\d+)\} was called[^{]*: (?P<state>[a-z]+)")
_RECOVERED = re.compile(r"[^{]*\{(\d+)\} is being recovered")
_KILLED_FOR = re.compile(r" was killed: failure '[^']*' of task (\d+)")


class Answers:
    """What was answered by which event, as central tells it."""

    def __init__(self) -> None:
        self.answered: set[tuple[float, int]] = set()
        self.failed: set[tuple[float, int]] = set()

    def note(self, time: float, entry: facts.Entry) -> None:
        for fact in entry.facts:
            if isinstance(fact, facts.Answered):
                self.answered.add((time, fact.id))
            elif isinstance(fact, facts.Failed):
                self.failed.add((time, fact.id))

    def is_told(self, run: Run, query: Message, time: float) -> bool:
        """Whether an answer, or the failure of its monitor, came of its failure, while who asked still ran."""
        if query.role is Role.CONDITION:
            return (time, query.about) in self.failed
        return (time, query.id) in self.answered and not _has_ended(query, time)


def _has_ended(failed: Failing, time: float) -> bool:
    return failed.by is not None and failed.by.end is not None and failed.by.end < time


class Answered(FoldedPlayer):
    """Folds a life, and notes what was answered."""

    def __init__(self) -> None:
        super().__init__()
        self.answers = Answers()

    def event(self, event: object) -> list[Effect]:
        effects = super().event(event)
        _note(self.answers, self.history, effects)
        return effects


class ToldAnswered(Told):
    """The same of handlers that block."""

    def __init__(self) -> None:
        self.answers = Answers()
        super().__init__()

    def event(self, event: object) -> list[Effect]:
        effects = super().event(event)
        _note(self.answers, self.history, effects)
        return effects


def _note(answers: Answers, run: Run, effects: list[Effect]) -> None:
    for effect in effects:
        if isinstance(effect, Record):
            answers.note(run.times[run.numbers.index(effect.entry.number)], effect.entry)


def assert_causes_come_first(run: Run, answers: Answers) -> None:
    """Of everything that failed."""
    for message in run.messages.values():
        _assert_story(run, message)
        if isinstance(message, Task):
            for moment in (inf, *run.times[:: max(len(run.times) // 5, 1)]):
                chain = failure_chain(run, TaskId(message.id), moment)
                _assert_chain(chain)
                _assert_known(RunAt(run, min(moment, run.time)), chain)
        elif message.message_class is MessageClass.QUERY:
            for time, failure in message.became("failure"):
                if failure:
                    assert is_told(run, message, time) == answers.is_told(run, message, time), f"{message} at {time}"
                    _assert_told(run, message, time)
    for handling in run.handlings:
        if handling.outcome is Outcome.FAILED and handling.end is not None:
            _assert_told(run, failing(run, handling), handling.end)
    for kind in failures(run):
        for case in kind.cases:
            assert case.fate is Fate.UNTOLD or not case.why.startswith(Fate.UNTOLD.words)
            assert case.recovery >= 0


def _assert_told(run: Run, failed: Failing, time: float) -> None:
    """Who is told had not ended, nor given up; with what nobody is told of nothing fails."""
    told = told_to(run, failed, time)
    if told.startswith(Fate.UNTOLD.words):
        assert not went_on(run, failed, time)
        assert fate(run, failed, time) is Fate.UNTOLD
    elif told:
        assert not _has_ended(failed, time), told
        assert isinstance(failed, Handling) or not failed.was("dropped", time), told


def _assert_chain(links: list[Link]) -> None:
    """One comes after the other, and who is killed for a failure after that. What is deeper happened no later than the
    last that is said of what is above it, or above that (of an exception handler nothing is said of what became of it
    later), unless that is not decided.
    """
    assert [one.time for one in links] == sorted(one.time for one in links), links
    last: dict[int, float] = {-1: inf}
    for one in links:
        last[one.depth] = inf if one.text.endswith(" is being recovered") else max(one.time, last.get(one.depth, 0.0))
    failed = [(place, int(found[1])) for place, one in enumerate(links) if (found := _FAILED.match(one.text))]
    for place, one in enumerate(links):
        assert one.time <= max(last.get(depth, 0.0) for depth in range(min(one.depth, 1) - 1, one.depth)), (
            f"{one} comes after what it led to: {links}"
        )
        killed_for = {int(number) for number in _KILLED_FOR.findall(one.text)}
        first = [other for other, number in failed if number in killed_for][:1]
        assert all(other < place for other in first), f"{one} comes before what it was killed for: {links}"


def _assert_known(at: RunAt, links: list[Link]) -> None:
    """What is said of how something stands, or goes on, is so at the moment as of which it is told."""
    for one in links:
        if (found := _STANDS.fullmatch(one.text)) is not None:
            assert found["state"] == at.tasks[TaskId(int(found["number"]))].state, f"{one} at {at.moment}: {links}"
        if (recovered := _RECOVERED.fullmatch(one.text)) is not None:
            assert at.tasks[TaskId(int(recovered[1]))].state in UNDECIDED, f"{one} at {at.moment}: {links}"


def _assert_story(run: Run, message: Message) -> None:
    """A sentence names nothing that was not there yet when it was over."""
    for one in story(run, message.id):
        end = run.time if one.is_open else one.time + (one.seconds or 0.0)
        for number in map(int, _NUMBER.findall(one.text)):
            named = run.messages.get(number)
            assert named is None or named.received <= end, f"{message} at {one.time}: {one.text}"


@given(st.lists(operation, max_size=50))
@settings(max_examples=60)
def test_no_cause_comes_later_than_its_effect(operations: list[tuple[str, int, int, int, int]]) -> None:
    player = Answered()
    life = Life(player)
    for name, *numbers in operations:
        life.do(name, *numbers)
    assert_causes_come_first(player.history, player.answers)


@given(steps)
@settings(max_examples=60)
def test_nor_of_handlers_that_block(taken: list[tuple[str, int, int, int]]) -> None:
    life = ToldAnswered()
    life.hello("operator")
    life.declare("user", "query missing")
    for step in taken:
        life.do(*step)
        life.tick(1.0)
    assert_causes_come_first(life.history, life.answers)


@given(st.integers(0, 1 << 32))
@settings(max_examples=2)
def test_nor_in_a_longer_life(seed: int) -> None:
    player = Answered()
    Life(player).go_on(seed, 200)
    assert_causes_come_first(player.history, player.answers)


@pytest.mark.soak
@given(st.integers(0, 1 << 32))
@settings(max_examples=150)
def test_nor_in_many_lives(seed: int) -> None:
    player = Answered()
    Life(player).go_on(seed, 300)
    assert_causes_come_first(player.history, player.answers)


@pytest.mark.soak
@given(steps)
@settings(max_examples=2_000)
def test_nor_of_many_handlers_that_block(taken: list[tuple[str, int, int, int]]) -> None:
    test_nor_of_handlers_that_block.hypothesis.inner_test(taken)  # type: ignore[attr-defined]
