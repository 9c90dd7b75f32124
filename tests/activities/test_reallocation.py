"""A running application with threads, whose activities are reallocated all the time, from Python
and by commands.
"""

import itertools
import time
from functools import partial

from tca_behaviours.activities import POLICIES, Application, one_for_all
from tca_behaviours.activities.components import Component
from tca_behaviours.activities.manager import ActivityMove, ApplicationMessages, Manager
from tca_module import Module, connect
from tca_module.testing import LocalCentral

PERIODS = {"quick": 0.005, "middle": 0.01, "slow": 0.02}
NAMES = ApplicationMessages("counters")


class Counted(Component[dict[str, int]]):
    """A component with three activities that count their ticks."""

    def __init__(self) -> None:
        super().__init__("c", dict)
        self.ticks = dict.fromkeys(PERIODS, 0)
        for name, period in PERIODS.items():
            region = self.region(name, period=0.05, estimate=0.0001)
            region.state("on", activity=partial(self.count, name), period=period, estimate=0.0001)

    def count(self, name: str) -> None:
        self.ticks[name] += 1


def test_no_tick_is_lost_or_doubled_by_reallocation() -> None:
    counted = Counted()
    application = Application("counters", [counted], one_for_all)
    with LocalCentral() as central, connect("user", central) as user:
        module = Module("counters", central)
        Manager(application).handle_in(module)
        before = time.monotonic()
        with module.running(), application.running():
            began = time.monotonic()
            moves = itertools.cycle(
                itertools.product([f"c.{name}.on" for name in PERIODS], ["a", "b"])
            )
            for policy in itertools.islice(itertools.cycle(POLICIES), 12):
                user.command(NAMES.set_policy, policy)
                for activity, processor in itertools.islice(moves, 5):
                    application.move(activity, processor)
                activity, processor = next(moves)
                user.command(NAMES.move, ActivityMove(activity, processor)).result()
                time.sleep(0.03)
            ended = time.monotonic()
            while user.get_variable(NAMES.allocation).policy != "by hand":
                assert time.monotonic() < ended + 60
                time.sleep(0.01)
        after = time.monotonic()
        sent = [
            entry
            for entry in central.transcript().splitlines()
            if "delivered: set policy of counters" in entry
        ]
        assert len(sent) == 12
    figures = {one.name: one for one in application.figures().activities}
    for name, period in PERIODS.items():
        ticks, left_out = (
            counted.ticks[name],
            figures[f"c.{name}.on"].left_out,
        )  # skipped on a busy machine
        assert (ended - began) / period - 1 - left_out <= ticks <= (after - before) / period + 1
