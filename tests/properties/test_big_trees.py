"""Everything that steers tasks works on trees of a hundred thousand, deep or wide: no recursion, nothing left behind."""

import pytest

from benchmarks.core_control import Steered

SIZE = 100_000


@pytest.mark.parametrize("deep", [False, True], ids=["wide", "deep"])
def test_failures_suspension_deadlines_wiretaps_and_kills_in_a_big_tree(deep: bool) -> None:
    bench = Steered()
    bottom = bench.grow(SIZE, deep=deep)
    bench.steady(bottom, 10)
    bench.operations(bottom)
    assert len(bench.central.tree.tasks) == 2  # the top-level task, and under it what leaves things safe
    assert not bench.central.dispatcher.freed
