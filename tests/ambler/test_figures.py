"""Figures of a walk: recovered faults and memory growth."""

import os

import pytest

from robots.ambler_sim.run.figures import ROUND, WARM_UP, Usage, growth_of, recovered, walked_on

STEPS = [10.0 * number for number in range(1, 31)]


@pytest.mark.parametrize(
    ("faults", "recoveries", "count"),
    [
        ([12.0, 55.0], [13.0, 57.0], 2),
        ([12.0, 55.0], [13.0, 14.0], 1),  # neither counts for the second fault
        ([12.0, 55.0], [57.0], 1),  # one does not count for both
        ([12.0, 13.0], [14.0, 15.0], 2),  # such as two legs at once
        ([12.0], [11.0], 0),  # too early
        ([12.0], [STEPS[ROUND] + 1.0], 1),
        ([12.0], [STEPS[ROUND + 1] + 1.0], 0),  # too late
        ([299.0], [310.0], 1),
        ([299.0], [], 0),
    ],
)
def test_fault_is_recovered_only_by_a_recovery_soon_after(
    faults: list[float], recoveries: list[float], count: int
) -> None:
    assert recovered(faults, recoveries, STEPS) == count


def test_lost_program_is_recovered_when_the_robot_walks_on() -> None:
    assert walked_on([12.0, 13.0, 300.0], STEPS) == 2
    assert walked_on([12.0], []) == 0


def test_memory_growth_is_measured_within_one_process() -> None:
    usage = Usage()
    for metres in (0.0, WARM_UP, 2 * WARM_UP):
        usage.measure(metres, {"central": os.getpid(), "gone": -1})
    memory = usage.at_end()
    assert memory.all == memory.central > 1.0
    assert memory.growth is not None
    usage.measure(3 * WARM_UP, {"central": os.getppid()})
    assert usage.at_end().growth == memory.growth  # the new process is too young


def test_memory_growth_counts_from_the_warm_up() -> None:
    assert growth_of([(10.0, 20.0), (100.0, 30.0), (160.0, 40.0), (260.0, 42.5)]) == 2.5
    assert growth_of([(10.0, 20.0), (200.0, 45.0)]) is None
