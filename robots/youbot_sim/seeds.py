"""Many deliveries with changing boxes, each with and without a preview: how much sooner the robot
is done, and what wrong predictions cost. Without physics and on a stepped clock, so each seed comes
out the same every time.
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

UNTIL = 12.0
"""By then the robot has passed box B."""


@dataclass(frozen=True, slots=True)
class SeedRow:
    """The same delivery with and without a preview."""

    seed: int
    lid: Lid
    plain: CarriedObject
    preview: CarriedObject
    foreseen: CarriedObject
    """With a preview, if box B had been from the beginning as it was when the robot came there."""

    @property
    def speed_up(self) -> float:
        """How many times sooner the robot is done."""
        return self.plain.seconds / self.preview.seconds

    @property
    def delay(self) -> float:
        """Seconds by which it would have been done sooner yet, had all predictions been right."""
        return self.preview.seconds - self.foreseen.seconds


def lid_of(seed: int) -> Lid:
    """Free or covered for a few seconds at a time, at random."""
    dice = random.Random(seed)  # noqa: S311 - not for secrets
    starts_covered, changes, time = dice.random() < 0.5, [], 0.0
    while (time := time + dice.uniform(SHORTEST, LONGEST)) < UNTIL:
        changes.append(round(time, 1))
    return Lid(tuple(changes), starts_covered)


def compare(seeds: int) -> Iterator[SeedRow]:
    """Seed by seed."""
    for seed in range(1, seeds + 1):
        lid = lid_of(seed)
        plain, preview = (_delivered(lid, has_preview=has_preview) for has_preview in (False, True))
        to_c = any(task.state == "going to C" for task in plain.tasks)
        yield SeedRow(
            seed, lid, plain, preview, _delivered(Lid(starts_covered=to_c), has_preview=True)
        )


def _delivered(lid: Lid, *, has_preview: bool) -> CarriedObject:
    return read_delivery(deliver(lid, make_coordinator(has_preview=has_preview)).entries)


HEAD = (
    "| seed | box B, seconds after the object was given | plain | preview | speed-up | arm ahead | in vain "
    "| delay |\n|---:|---|---:|---:|---:|---|---:|---:|"
)


def row(one: SeedRow) -> str:
    """Of the table."""
    kept, wasted = (len(one.preview.with_role(role)) for role in (TaskRole.KEPT, TaskRole.WASTED))
    ahead = ", ".join([f"{kept} kept"] * bool(kept) + [f"{wasted} wasted"] * bool(wasted)) or "none"
    return (
        f"| {one.seed} | {one.lid} | {one.plain.seconds:.1f} s | {one.preview.seconds:.1f} s | {one.speed_up:.2f} "
        f"| {ahead} | {one.preview.seconds_in_vain:.1f} s | {one.delay:.1f} s |"
    )


def summary(rows: list[SeedRow]) -> str:
    """Under the table."""
    best, worst = max(one.speed_up for one in rows), min(one.speed_up for one in rows)
    wrong = [one for one in rows if one.preview.with_role(TaskRole.WASTED)]
    vain = sum(one.preview.seconds_in_vain for one in rows)
    late = sum(one.delay for one in rows)
    saved = sum(one.plain.seconds - one.preview.seconds for one in rows)
    return (
        f"Speed-up {geometric_mean(one.speed_up for one in rows):.2f} (geometric mean), from {worst:.2f} to "
        f"{best:.2f}: {saved:.1f} s saved. Wrong predictions in {len(wrong)} of {len(rows)} runs: the arm moved "
        f"{vain:.1f} s in vain, and all deliveries together took {late:.1f} s longer than with right ones."
    )
