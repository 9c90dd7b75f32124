"""Random machines: early work never blocks the current activity."""

import re
from random import Random
from typing import NamedTuple

import pytest
from coordination.conditions import check_conditions
from coordination.executions import check_executions
from coordination.random_machines import FREE, disturb, random_machine, random_round, run_of
from hypothesis import given, settings
from hypothesis import strategies as st
from sampling import lives

from tca_behaviours.coordination import Coordination, Discrete, Policy
from tca_wire.coordination import read_report
from tca_wire.journal.facts import Entry, StateChanged

EAGER = Discrete(0.5, utility=lambda _: 1.0)
"""A policy that starts every foreseen activity."""
SEEDS = st.integers(0, 10**6)


class SimulatedRun(NamedTuple):
    """A run with its random events, but without its end."""

    transcript: str
    entries: list[Entry]

    @property
    def path(self) -> list[str]:
        """Return the transitions of the run."""
        facts = [
            fact for entry in self.entries for fact in entry.facts if isinstance(fact, StateChanged)
        ]
        reports = [report for fact in facts if (report := read_report(fact.body)) and report.taken]
        return [f"{report.before} {report.taken} {report.current}" for report in reports]


def simulate(
    machine: Coordination, policy: Policy | None, seed: int, acts: int = 25
) -> SimulatedRun:
    """Run a machine on a robot with at most *acts* random events."""
    random = Random(seed)
    with run_of(machine, policy) as run:
        if random.random() < 0.8:
            run.user.set_variable(FREE, random.choice([0.0, 0.5, 1.0]))
            run.central.until_quiet()
        run.begin()
        disturb(random, run, acts)
        run.central.advance(200 if not acts else 0)
        return SimulatedRun(run.central.transcript(), run.central.entries[:])


@settings(max_examples=lives(5, soak=200))
@given(SEEDS)
def test_run_without_likelihoods_equals_a_plain_run(seed: int) -> None:
    machine = random_machine(Random(seed), unlikely=True)
    ahead, plain = (
        simulate(machine, EAGER, seed).transcript,
        simulate(machine, None, seed).transcript,
    )
    assert re.sub(r'"refused": \[[^]]*\]', '"refused": []', ahead) == plain


@settings(max_examples=lives(5, soak=200))
@given(SEEDS)
def test_early_work_keeps_conditions_of_the_current_activity(seed: int) -> None:
    machine = random_machine(Random(seed))
    check_conditions(machine, simulate(machine, EAGER, seed).entries)


@pytest.mark.soak
@settings(max_examples=lives(5, soak=200))
@given(SEEDS)
def test_preview_does_not_change_the_path_of_the_machine(seed: int) -> None:
    machine = random_machine(Random(seed))
    ahead, plain = (simulate(machine, policy, seed, acts=0).path for policy in (EAGER, None))
    both = min(len(ahead), len(plain))
    assert ahead[:both] == plain[:both]
    assert len(ahead) >= len(plain) // 2  # wrong predictions may cost time, but never stall the run


@pytest.mark.soak
@settings(max_examples=lives(7, soak=200))
@given(SEEDS)
def test_each_state_visit_has_its_own_execution(seed: int) -> None:
    machine = random_round(Random(seed))
    check_executions(machine, simulate(machine, EAGER, seed).entries)


@pytest.mark.soak
def test_random_rounds_often_start_executions_early() -> None:
    rounds = [(random_round(Random(seed)), seed) for seed in range(8)]
    assert (
        sum(
            check_executions(machine, simulate(machine, EAGER, seed).entries)
            for machine, seed in rounds
        )
        > 8
    )
