"""What the tools say of exception handlers that could not decide, from what central writes."""

from pathlib import Path

import msgspec
import pytest
from central.transcript import Transcript
from tools.runs import OPENED, checked

from tca_tools.analysis.failures import failures
from tca_tools.check import rules
from tca_tools.run.fates import Fate
from tca_tools.run.fold import History
from tca_tools.tasktree_viz.told import story_lines
from tca_wire.journal import facts
from tca_wire.journal.facts import Entry
from tca_wire.points import ROOT, TaskId

TRANSCRIPTS = Path(__file__).parent.parent / "central" / "transcripts"


def entries_of(transcript: str) -> list[Entry]:
    """What central writes when a transcript is played."""
    played = Transcript()
    for block in (TRANSCRIPTS / f"{transcript}.txt").read_text().strip().split("\n\n")[1:]:
        for command in block.split("\n----")[0].splitlines():
            played.play(command)
    return played.player.entries


def folded(transcript: str) -> History:
    history = History()
    for entry in entries_of(transcript):
        history.apply(entry)
    return history


def test_a_failure_that_somebody_further_out_dealt_with_was_overcome() -> None:
    cases = {kind.failure: kind.cases[0] for kind in failures(folded("failures_of_exception_handlers_in_one_another"))}
    assert {name: case.fate for name, case in cases.items()} == {
        "slip": Fate.DEALT_WITH, "handler error": Fate.REPLACED, "module lost": Fate.REPLACED,
    }  # fmt: skip
    assert cases["slip"].called == [
        "recover {5} was called, handled by expert: failed",
        "report {7} was called, handled by office",
    ]


def test_where_nobody_could_decide_the_story_leads_to_the_first_failure_and_from_there_to_the_others() -> None:
    lines = list(story_lines(folded("failures_that_nobody_could_decide_about"), TaskId(3), 200))
    told = [line[11:] for line in lines[lines.index("its failure, step by step:") + 1 :]]
    assert [line for line in told if " failed: " in line] == [
        "  move {4} failed: slip: why",
        "    recover {5} failed: module lost: module 'expert' was lost: its connection closed",
        "    report {6} failed: handler error: why",
    ]


@pytest.mark.parametrize("undecided", [ROOT, 4, 6])
def test_an_exception_handler_that_could_not_decide_must_be_the_nearest_and_end(undecided: int) -> None:
    """Task 5 is that of the exception handler that fails, 4 the one that it deals with, 6 another exception handler."""
    entries = [OPENED, *entries_of("failures_that_nobody_could_decide_about")]
    assert checked(entries) == []
    first = next(one for one in entries if any(isinstance(fact, facts.Unhandled) for fact in one.facts))
    for place, fact in enumerate(first.facts):
        if isinstance(fact, facts.Unhandled):
            first.facts[place] = msgspec.structs.replace(fact, undecided=TaskId(undecided))
    assert rules.CAUGHT.text in {violation.rule for violation in checked(entries)}
