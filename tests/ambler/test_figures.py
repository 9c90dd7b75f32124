"""What counts as recovered."""

import pytest

from robots.ambler_sim.run.figures import ROUND, recovered

STEPS = [10.0 * number for number in range(1, 31)]


@pytest.mark.parametrize(
    ("faults", "recoveries", "count"),
    [
        ([12.0, 55.0], [13.0, 57.0], 2),
        ([12.0, 55.0], [13.0, 14.0], 1),  # two after the first are none for the second
        ([12.0, 55.0], [57.0], 1),  # what comes after the second is none for the first
        ([12.0], [11.0], 0),  # nothing recovers from what is to come
        ([12.0], [STEPS[ROUND] + 1.0], 1),
        ([12.0], [STEPS[ROUND + 1] + 1.0], 0),  # too late to be meant
        ([299.0], [310.0], 1),
        ([299.0], [], 0),
    ],
)
def test_a_fault_is_recovered_by_what_follows_soon(faults: list[float], recoveries: list[float], count: int) -> None:
    assert recovered(faults, recoveries, STEPS) == count
