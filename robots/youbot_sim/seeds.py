"""Deliveries with changing boxes, each with and without a preview: the time saved, and the cost of
wrong predictions.

They run without physics on a stepped clock, so each seed always gives the same result.
"""

import random
from collections.abc import Iterator
from dataclasses import dataclass
from statistics import geometric_mean

from robots.youbot_sim.coordination import make_coordinator
from robots.youbot_sim.outcome import CarriedObject, read_delivery
from robots.youbot_sim.simulator import Lid
from robots.youbot_sim.stepped import deliver
from tca_wire.coordination import TaskRole

SHORTEST, LONGEST = 1.0, 8.0
"""Seconds between two changes of box B."""

AT_BOX_B = 12.0
"""Seconds within which the robot comes to box B. Later changes of the box would have no effect."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """The same delivery with and without a preview."""

    seed: int
    lid: Lid
    plain: CarriedObject
    preview: CarriedObject
    foreseen: CarriedObject
    """The delivery with a preview and a right prediction: box B is from the start as the robot
    finds it.
    """

    @property
    def speed_up(self) -> float:
        """How many times faster the delivery with the preview is."""
        return self.plain.seconds / self.preview.seconds

    @property
    def delay(self) -> float:
        """Seconds that wrong predictions cost."""
        return self.preview.seconds - self.foreseen.seconds


def random_lid(seed: int) -> Lid:
    """Return a lid that is put on and taken off at random times."""
    dice = random.Random(seed)  # noqa: S311 - not for secrets
    starts_covered, changes, time = dice.random() < 0.5, [], 0.0
    while (time := time + dice.uniform(SHORTEST, LONGEST)) < AT_BOX_B:
        changes.append(round(time, 1))
    return Lid(tuple(changes), starts_covered)


def compare(seeds: int) -> Iterator[Comparison]:
    """Run the deliveries, seed by seed."""
    for seed in range(1, seeds + 1):
        lid = random_lid(seed)
        plain, preview = (_delivered(lid, has_preview=has_preview) for has_preview in (False, True))
        to_c = any(task.state == "going to C" for task in plain.tasks)
        yield Comparison(
            seed, lid, plain, preview, _delivered(Lid(starts_covered=to_c), has_preview=True)
        )


def _delivered(lid: Lid, *, has_preview: bool) -> CarriedObject:
    return read_delivery(deliver(lid, make_coordinator(has_preview=has_preview)).entries)


TABLE_HEAD = (
    "| seed | box B, seconds after the object was given | plain | preview | speed-up | arm ahead "
    "| in vain | delay |\n|---:|---|---:|---:|---:|---|---:|---:|"
)


def row(comparison: Comparison) -> str:
    """Format a row of the table."""
    plain, preview = comparison.plain, comparison.preview
    kept, wasted = (len(preview.with_role(role)) for role in (TaskRole.KEPT, TaskRole.WASTED))
    ahead = ", ".join([f"{kept} kept"] * bool(kept) + [f"{wasted} wasted"] * bool(wasted)) or "none"
    return (
        f"| {comparison.seed} | {comparison.lid} | {plain.seconds:.1f} s | {preview.seconds:.1f} s "
        f"| {comparison.speed_up:.2f} | {ahead} | {preview.seconds_in_vain:.1f} s "
        f"| {comparison.delay:.1f} s |"
    )


def summary(rows: list[Comparison]) -> str:
    """Summarise the table."""
    speed_ups = [each.speed_up for each in rows]
    wrong = [each for each in rows if each.preview.with_role(TaskRole.WASTED)]
    vain = sum(each.preview.seconds_in_vain for each in rows)
    late = sum(each.delay for each in rows)
    saved = sum(each.plain.seconds - each.preview.seconds for each in rows)
    return (
        f"Speed-up {geometric_mean(speed_ups):.2f} (geometric mean),"
        f" from {min(speed_ups):.2f} to {max(speed_ups):.2f}: {saved:.1f} s saved."
        f" Wrong predictions in {len(wrong)} of {len(rows)} runs: the arm moved {vain:.1f} s in"
        f" vain, and all deliveries together took {late:.1f} s longer than with right ones."
    )
