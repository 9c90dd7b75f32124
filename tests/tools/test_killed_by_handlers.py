"""Failures of exception handlers: outer handlers, and handlers that could not decide."""

import msgspec
import pytest
from tools.runs import OPENED, checked, played

from tca_tools.analysis.failures import failures
from tca_tools.check import rules
from tca_tools.journal.fates import Fate
from tca_tools.journal.fold import History
from tca_tools.tasktree_viz.text import story_lines
from tca_wire.journal import facts
from tca_wire.points import ROOT, TaskId


def test_failure_handled_by_an_outer_handler_is_dealt_with() -> None:
    cases = {
        kind.failure: kind.cases[0]
        for kind in failures(History.until(played("failures_of_nested_exception_handlers").entries))
    }
    assert {name: case.fate for name, case in cases.items()} == {
        "slip": Fate.DEALT_WITH,
        "handler error": Fate.REPLACED,
        "module lost": Fate.REPLACED,
    }
    assert cases["slip"].called == [
        "recover {5} was called in expert: failed (handler error: why)",
        "report {7} was called in office",
    ]


def test_undecided_failure_story_starts_from_the_first_failure() -> None:
    lines = list(
        story_lines(
            History.until(played("failures_undecided_by_all_handlers").entries), TaskId(3), 200
        )
    )
    steps = [line[11:] for line in lines[lines.index("its failure, step by step:") + 1 :]]
    assert [line for line in steps if " failed: " in line] == [
        "  move {4} failed: slip: why",
        "    recover {5} failed: module lost: module 'expert' was lost: its connection closed",
        "    report {6} failed: handler error: why",
    ]


@pytest.mark.parametrize("undecided", [ROOT, 4, 6])
def test_check_finds_a_wrong_undecided_exception_handler(
    undecided: int,
) -> None:
    """Task 4 fails. Its exception handler 5 fails, too. Task 6 is another exception handler."""
    entries = [OPENED, *played("failures_undecided_by_all_handlers").entries]
    assert checked(entries) == []
    first = next(
        one for one in entries if any(isinstance(fact, facts.Unhandled) for fact in one.facts)
    )
    for place, fact in enumerate(first.facts):
        if isinstance(fact, facts.Unhandled):
            first.facts[place] = msgspec.structs.replace(fact, undecided=TaskId(undecided))
    assert rules.CAUGHT.text in {violation.rule for violation in checked(entries)}
