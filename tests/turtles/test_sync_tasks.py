"""SetStatusSync and WaitForStatusSync on a turtle's task server, with the links of its partners."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from turtles.towns import Town, town, until_known

from robots.turtle_sim.sync.environment import SyncEnvironment
from robots.turtle_sim.sync.link import StatusLink
from robots.turtle_sim.sync.tasks import TASKS_OF_TEAMS
from robots.turtle_sim.sync.team import free_team
from tca_behaviours.missions import (
    MISSION_TASK_INITIALISATION_FAILED,
    MISSION_TASK_TIMEOUT,
    TaskStatus,
)
from tca_module import Outcome, TaskFailed


@contextmanager
def team() -> Iterator[tuple[Town, StatusLink, StatusLink]]:
    """Run a town of turtle "a", with its link and the link of its partner "b". A third partner "c"
    never appears.
    """
    addresses = free_team("a", "b", "c")
    with (
        StatusLink("a", addresses, loss=0.5) as own,
        StatusLink("b", addresses, loss=0.5) as partner,
    ):
        with town(environment=SyncEnvironment(own), tasks=TASKS_OF_TEAMS) as there:
            yield there, own, partner


def test_set_status_reaches_the_partner() -> None:
    with team() as (there, _, partner):
        there.run("SetStatusSync", status=3)
        until_known(partner, "a", 3)


def test_wait_for_status_ends_when_the_partner_has_it() -> None:
    with team() as (there, own, partner):
        waiting = there.start("WaitForStatusSync", partner="b", status=2)
        waiting.follow()
        partner.set_status(1)
        until_known(own, "b", 1)
        there.central.advance(1.0)
        assert waiting.info() is not None
        partner.set_status(2)
        until_known(own, "b", 2)
        there.central.advance(0.2)
        assert waiting.wait(timeout=5) is Outcome.DONE
        said = [status.text for status in waiting.progress(TaskStatus) if status.text]
        assert said[-1] == "waits for status 2: the status of 'b' is 1"


def test_wait_for_an_unknown_partner_fails_at_once() -> None:
    with team() as (there, _, _), pytest.raises(TaskFailed) as failed:
        there.run("WaitForStatusSync", partner="z", status=1)
    assert failed.value.failure == MISSION_TASK_INITIALISATION_FAILED.name
    assert "'a' has no partner 'z': its partners are b, c" in str(failed.value)


def test_wait_timeout_names_the_missing_partner() -> None:
    with team() as (there, _, _), pytest.raises(TaskFailed) as failed:
        there.run("WaitForStatusSync", partner="c", status=1, task_timeout=5.0)
    assert failed.value.failure == MISSION_TASK_TIMEOUT.name
    assert "it ran for 5 s: waits for status 1: 'c' has sent nothing" in str(failed.value)
