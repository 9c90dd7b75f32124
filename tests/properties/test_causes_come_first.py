"""No cause is later than its effect. No module receives a failure after it gave up or ended, and no
failure follows from a later one. This holds in stories, in chains of failures and in the fates of
failures.
"""

import re
from math import inf

from hypothesis import given, settings
from properties.blocking import Steps
from properties.folded import FoldedPlayer
from properties.life import Life, Operations, operations
from properties.test_recorded_waits import JournaledLife, steps
from sampling import lives

from tca_tools.analysis.failures import failures
from tca_tools.explain.story import story
from tca_tools.journal.fates import (
    Fate,
    describe_asker,
    fate,
    is_reported,
    run_continued,
)
from tca_tools.journal.records import Message, Task
from tca_tools.journal.whole_run import Run
from tca_tools.tasktree_viz.failing import failure_chain
from tca_wire.journal import facts
from tca_wire.points import TaskId
from tca_wire.vocabulary import MessageClass, Outcome, Role

_NUMBER = re.compile(r"\{(\d+)\}")


class Answers:
    """The answers and failures of each event, according to central."""

    def __init__(self, run: Run, entries: list[facts.Entry]) -> None:
        times = dict(zip(run.numbers, run.times, strict=True))
        timed_facts = [(times[entry.number], fact) for entry in entries for fact in entry.facts]
        self.answered = {
            (time, fact.id) for time, fact in timed_facts if isinstance(fact, facts.Answered)
        }
        self.failed = {
            (time, fact.id) for time, fact in timed_facts if isinstance(fact, facts.Failed)
        }

    def is_reported(self, query: Message, time: float) -> bool:
        """Whether the failure of a query led to an answer, or to the failure of its monitor, while
        the asker still ran.
        """
        if query.role is Role.CONDITION:
            return (time, query.about) in self.failed
        return (time, query.id) in self.answered and not _has_ended(query, time)


def _has_ended(failed: Message, time: float) -> bool:
    return failed.by is not None and failed.by.until < time


def assert_causes_come_first(run: Run, entries: list[facts.Entry]) -> None:
    """Check every story, failure chain and fate of a run."""
    answers = Answers(run, entries)
    for message in run.messages.values():
        for one in story(run, message.id):
            _assert_known(
                run, one.text, run.time if one.is_open else one.time + (one.seconds or 0.0)
            )
        if isinstance(message, Task):
            for instant in (inf, *run.times[:: max(len(run.times) // 5, 1)]):
                chain = failure_chain(run, TaskId(message.id), instant)
                assert [one.time for one in chain] == sorted(one.time for one in chain), chain
                for link in chain:
                    _assert_known(run, link.text, min(instant, run.time))
        elif message.message_class is MessageClass.QUERY:
            for time, failure in message.new_values("failure"):
                if failure:
                    assert is_reported(run, message, time) == answers.is_reported(message, time), (
                        f"{message} at {time}"
                    )
                    _assert_told(run, message, time)
    for handling in run.handlings:
        if handling.outcome is Outcome.FAILED and handling.end is not None:
            _assert_told(run, run.messages[handling.message_id], handling.end)
    for case in (case for kind in failures(run) for case in kind.cases):
        assert case.fate is Fate.NOT_REPORTED or not case.why.startswith(Fate.NOT_REPORTED.words)
        assert case.recovery >= 0


def _assert_known(run: Run, text: str, instant: float) -> None:
    """Assert that a text names no message that was sent after *instant*."""
    named = [
        run.messages[number] for number in map(int, _NUMBER.findall(text)) if number in run.messages
    ]
    assert all(one.received <= instant for one in named), f"at {instant}: {text}"


def _assert_told(run: Run, failed: Message, time: float) -> None:
    """Assert that the receiver of a failure had neither ended nor given up. A failure without a
    receiver must cause no other failure.
    """
    receivers = describe_asker(run, failed, time)
    if receivers.startswith(Fate.NOT_REPORTED.words):
        assert not run_continued(run, failed, time)
        assert fate(run, failed, time) is Fate.NOT_REPORTED
    elif receivers:
        assert not _has_ended(failed, time), receivers
        assert not failed.value_at("dropped", time), receivers


@given(operations)
@settings(max_examples=lives(20, soak=300))
def test_no_cause_is_later_than_its_effect(taken: Operations) -> None:
    player = FoldedPlayer()
    Life(player).live(taken)
    assert_causes_come_first(player.history, player.entries)


@given(steps)
@settings(max_examples=lives(15, soak=2_000))
def test_no_cause_is_later_than_its_effect_when_handlers_block(taken: Steps) -> None:
    life = JournaledLife().live(taken)
    assert_causes_come_first(life.history, life.entries)
