"""What users' tests rely on."""

import threading

import pytest
from module.gait_messages import REST

from tca_module import CentralLost, Client, connect
from tca_module.testing import LocalCentral
from tca_wire.journal.facts import kind_of


def test_the_invariants_of_central_are_checked_after_every_event_where_that_is_wanted(
    central: LocalCentral, user: Client
) -> None:
    user.goal(REST)
    central.core.tree.tasks[1].held = 1
    with pytest.raises(AssertionError):
        user.goal(REST)
    central.core.tree.tasks[1].held = 0


def test_checks_are_only_made_for_those_who_want_them() -> None:
    with LocalCentral() as central, connect("user", central) as user:
        user.goal(REST)
        central.core.tree.tasks[1].held = 1
        user.goal(REST)


def test_the_journal_is_there_to_be_looked_at(central: LocalCentral, user: Client) -> None:
    user.goal(REST)
    kinds = [kind_of(fact) for fact in central.facts]
    assert kinds == ["module joined", "format", "received", "queued"]
    assert [entry.number for entry in central.entries] == [1, 2, 3]
    assert all(entry.time >= 0 for entry in central.entries)


def test_a_closed_central_answers_nobody(central: LocalCentral, user: Client) -> None:
    central.close()
    with pytest.raises(CentralLost, match="central at local central 'local' does not answer"):
        connect("late", central, patience=0.05)


def test_a_closed_central_leaves_no_thread_behind() -> None:
    before = set(threading.enumerate())
    with LocalCentral() as central, connect("user", central) as user:
        user.goal(REST)
        assert set(threading.enumerate()) != before
    central.close()
    assert set(threading.enumerate()) <= before
