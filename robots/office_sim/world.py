"""The true lab: cups that fall down and are picked up, a robot with a hand and a battery.

It has no clock: time passes only in `advance`. The same seed with the same calls at the same times
gives the same result.
"""

import itertools
import math
import random
from collections.abc import Iterator
from dataclasses import dataclass

from robots.office_sim.floor import make_floor
from robots.office_sim.messages import REACH
from robots.office_sim.vocabulary import CupState, Grasped, LabScene, SeenCup, Spot, Stretch

STEP = 0.1
"""The longest simulated step in seconds."""

SPEED = 0.6
DRIVING, STANDING, CHARGING = 0.006, 0.0006, 0.03
"""The share of the battery that a second uses or, at the charger, adds."""

FULL = 0.9999
"""The charge at which the battery counts as full."""

BETWEEN_CUPS = 20.0
"""Mean seconds between two cups."""

TAKEN = 0.35
"""The share of the cups that people pick up."""

TAKEN_AFTER = (4.0, 60.0)
"""The least and the greatest number of seconds after which a person picks up a cup."""

SLIPS = (0, 0, 0, 1, 1, 4)
"""How often a cup may slip out of the fingers."""

ROOM = 0.36
"""The distance (m) of a cup from walls and tables."""

APART, FROM_BIN = 0.4, 1.5
"""The least distance (m) between two cups, and of a cup from the bin."""

TOLERANCE = 0.12
"""The allowed position error (m) of the hand."""

MISSED, BLUR = 0.03, 0.01
"""The probability that the camera misses a cup, and the error (m) of its places."""


@dataclass(slots=True)
class WorldCup(SeenCup):
    """A cup, with its future: when it falls, when it is picked up, and how often it slips."""

    falls: float
    taken: float
    slips: int


class OfficeWorld:
    """The lab of a seed during a shift of *shift* seconds."""

    def __init__(self, seed: int, shift: float, battery: float = 1.0) -> None:
        rng = random.Random(seed)  # noqa: S311 - no secret
        self.time = 0.0
        self.floor = make_floor(rng)
        self._cups = list(self._make_cups(rng, shift))
        self._camera_random = random.Random(seed)  # noqa: S311
        self.robot = Spot(self.floor.charger.x - 0.6, self.floor.charger.y + 0.3)
        self._way: list[Spot] = []
        self.battery, self._charges, self._is_docked = battery, 0, False
        self._trail = [Stretch(with_cup=False, points=[self.robot])]
        self._happened: list[str] = []

    def _make_cups(self, rng: random.Random, shift: float) -> Iterator[WorldCup]:
        """Yield the cups that fall during the shift, at least one."""
        spots: list[Spot] = []
        time = rng.uniform(1.0, 5.0)
        while not spots or time < shift:
            spots.append(self._another_spot(rng, spots))
            taken = time + rng.uniform(*TAKEN_AFTER) if rng.random() < TAKEN else math.inf
            yield WorldCup(len(spots), spots[-1], CupState.TO_COME, time, taken, rng.choice(SLIPS))
            time += rng.expovariate(1 / BETWEEN_CUPS)

    def _another_spot(self, rng: random.Random, others: list[Spot]) -> Spot:
        floor = self.floor
        while True:
            spot = Spot(rng.uniform(0.0, floor.width), rng.uniform(0.0, floor.depth))
            is_apart = all(spot.to(other) >= APART for other in others)
            if is_apart and floor.is_free(spot, ROOM) and spot.to(floor.bin) >= FROM_BIN:
                return spot

    def advance(self, to: float) -> None:
        """Let time pass until *to*."""
        while self.time < to:
            step = min(STEP, to - self.time)
            self.time = to if step < STEP else self.time + step
            self._move_cups()
            self._drive_on(step)

    def _move_cups(self) -> None:
        for cup in self._cups:
            if cup.state is CupState.TO_COME and self.time >= cup.falls:
                self._set_state(cup, CupState.FLOOR)
            if cup.state is CupState.FLOOR and self.time >= cup.taken:
                self._set_state(cup, CupState.TAKEN)

    def _drive_on(self, seconds: float) -> None:
        remaining = SPEED * seconds if self.battery > 0 else 0.0
        is_moving = bool(self._way) and remaining > 0
        while self._way and remaining > 0:
            ahead = self.robot.to(self._way[0])
            if ahead <= remaining:
                self.robot = self._way.pop(0)
                self._trail[-1].points.append(self.robot)
            else:
                self.robot = self.robot.towards(self._way[0], remaining)
            remaining -= ahead
        power = CHARGING if self._is_docked else -(DRIVING if is_moving else STANDING)
        self.battery = min(max(self.battery + power * seconds, 0.0), 1.0)
        if self._is_docked and self.battery >= FULL:
            self._is_docked = False
            self._log_event("the battery is full")

    def _set_state(self, cup: WorldCup, state: CupState) -> None:
        cup.state = state
        self._log_event(f"cup {cup.number} is {state}")

    def _log_event(self, what: str) -> None:
        self._happened.append(f"{self.time:6.1f} s  {what}")

    def seen_spots(self) -> list[Spot]:
        """Return the cups that the camera on the ceiling sees. It misses some and is not exact."""
        seen = [
            cup.spot
            for cup in self._cups_in(CupState.FLOOR)
            if self._camera_random.random() >= MISSED
        ]
        return [
            Spot(
                spot.x + self._camera_random.gauss(0, BLUR),
                spot.y + self._camera_random.gauss(0, BLUR),
            )
            for spot in seen
        ]

    def drive(self, way: list[Spot]) -> float:
        """Set off. Returns the duration in seconds."""
        self.halt()
        self._way, self._is_docked = list(way), False
        return sum(here.to(there) for here, there in itertools.pairwise([self.robot, *way])) / SPEED

    def halt(self) -> Spot:
        """Stop. Returns the place."""
        if self._way:
            self._way = []
            self._trail[-1].points.append(self.robot)
        return self.robot

    def close_fingers(self, spot: Spot) -> Grasped:
        """Grasp the cup at a spot."""
        near = [
            cup
            for cup in self._cups_in(CupState.FLOOR)
            if cup.spot.to(spot) <= TOLERANCE and self._reaches(spot)
        ]
        if not near or self._cups_in(CupState.HAND):
            return Grasped.NOTHING
        cup = near[0]
        if cup.slips:
            cup.slips -= 1
            self._log_event(f"cup {cup.number} slips")
            return Grasped.SLIPPED
        self._set_state(cup, CupState.HAND)
        self._trail.append(Stretch(with_cup=True, points=[self.robot]))
        return Grasped.CUP

    def open_fingers(self) -> bool:
        """Let go of the cup, into the bin or onto the floor. Returns whether there was one."""
        held = self._cups_in(CupState.HAND)
        for cup in held:
            if self._reaches(self.floor.bin):
                self._set_state(cup, CupState.BIN)
            else:
                cup.spot = self.robot
                self._set_state(cup, CupState.FLOOR)
            self._trail.append(Stretch(with_cup=False, points=[self.robot]))
        return bool(held)

    def dock(self) -> float | None:
        """Start to charge the battery. Returns the seconds until it is full; None too far from the
        charger.
        """
        if self.robot.to(self.floor.charger) > TOLERANCE:
            return None
        self._is_docked = True
        self._charges += 1
        self._log_event(f"the battery is being charged, from {self.battery:.0%}")
        return (1.0 - self.battery) / CHARGING

    def _cups_in(self, state: CupState) -> list[WorldCup]:
        return [cup for cup in self._cups if cup.state is state]

    def _reaches(self, spot: Spot) -> bool:
        return self.robot.to(spot) <= REACH + TOLERANCE

    def scene(self) -> LabScene:
        """Return the lab seen from above."""
        trail = [Stretch(stretch.with_cup, stretch.points[:]) for stretch in self._trail]
        trail[-1].points.append(self.robot)
        cups = [SeenCup(cup.number, cup.spot, cup.state) for cup in self._cups]
        return LabScene(
            self.time,
            self.floor,
            self.robot,
            self.battery,
            self._charges,
            cups,
            trail,
            self._happened[:],
        )
