"""Activities that record their ticks, and random task sets."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from hypothesis import strategies as st

from tca_behaviours.activities import VirtualBaton
from tca_behaviours.activities.analysis import Demand


@dataclass
class Ticked:
    """An activity that records the times of its ticks."""

    name: str
    period: float
    estimate: float | None = None
    component: str = "made"
    log: list[tuple[str, float]] = field(default_factory=list)
    now: Callable[[], float] = lambda: 0.0

    def tick(self) -> None:
        self.log.append((self.name, self.now()))


def in_virtual_time(processors: Sequence[Sequence[Demand]]) -> VirtualBaton:
    """Start processors, in order of priority, in virtual time. Each tick takes as long as its
    activity's estimate.
    """
    baton = VirtualBaton()
    with baton.changing() as schedule:
        for number, demands in enumerate(processors):
            processor = schedule.new_processor(f"p{number}", 0.0)
            processor.priority = -number
            for name, period, cost in demands:
                schedule.add(Ticked(name, period, cost))
                schedule.put(schedule.activity(name), processor, 0.0)
    baton.start()
    return baton


@st.composite
def task_sets(
    draw: st.DrawFn, periods: Sequence[int] = (4, 5, 6, 8, 10, 12, 20, 24)
) -> list[Demand]:
    """Draw a task set by UUniFast, with any utilisation and period. All times are whole numbers."""
    number = draw(st.integers(1, 6))
    left = draw(st.floats(0.3, 1.1))
    found = []
    for place in range(number):
        rest = (
            left * draw(st.floats(0.01, 0.99)) ** (1 / (number - place - 1))
            if place < number - 1
            else 0.0
        )
        period = draw(st.sampled_from(periods)) * 1000
        found.append(Demand(f"a{place}", period, min(period, max(1, int((left - rest) * period)))))
        left = rest
    return found
