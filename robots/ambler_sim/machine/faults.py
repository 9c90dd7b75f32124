"""Faults of the machine, its sensors and the ground, on any plant: what goes wrong, until when, and
how that shows.

A plant is wrapped: what is commanded and what is measured passes through here. A fault is armed
first, and begins when it can: those of the scanner at once, those of the machine and soft ground
after a move, a rock before one.
"""

from collections.abc import Sequence

import numpy as np

from robots.ambler_sim.geometry import Array, distance, stance_of
from robots.ambler_sim.machine.motion import HANGING_LOAD, Segment
from robots.ambler_sim.machine.plant import Plant
from robots.ambler_sim.machine.terrain import HOLE_RADIUS, Terrain
from robots.ambler_sim.planning.stability import support_margin
from robots.ambler_sim.vocabulary import (
    LEGS,
    MACHINE_KINDS,
    ROCK,
    SCANNER_KINDS,
    SOFT_SPOT,
    Fault,
    Rock,
    Stance,
)

LAG = 0.25
"""The share of its speed that a joint with a motion fault has left."""

DRIFT = 0.08
"""Metres that a drifting encoder is off, unless the fault says how much."""

ROCK_RADIUS, ROCK_ROOM, ROCK_ABOVE = 0.2, 0.6, 0.15
"""Of a rock that is put in the way (m): its least distance from the foot before, and its height
above the way.
"""

HIGHEST_ROCK = 1.0
"""Metres above the ground around it."""

SPARED = 0.5
"""Metres: ground gives way under legs without which the robot stands by that much; else it would
rock.
"""


class FaultyPlant:
    """A plant with faults: what is commanded to it, and what can be wrong of what it measures."""

    def __init__(
        self, plant: Plant, faults: Sequence[Fault] = (), armed: Sequence[Fault] = ()
    ) -> None:
        self.plant = plant
        self.faults = list(faults)
        """What is wrong with machine and scanner now."""
        self.armed = list(armed)
        """What waits until it can begin."""
        self._begun: list[Fault] = []

    # --- what goes wrong --------------------------------------------------------------------------

    def arm(self, fault: Fault) -> None:
        """It begins when it can."""
        self.armed.append(fault)
        if fault.kind in SCANNER_KINDS:
            self.faults.append(fault)
            self._begin(fault)

    def before_swing(self, leg: int, swing: Segment, terrain: Terrain) -> None:
        """Put a rock in the middle of the way that a lifted foot swings, higher than that is, if
        there is room.
        """
        for fault in self._armed_of(ROCK)[:1]:
            joints = self.plant.joints()
            joints[leg] = swing.at(0.5)
            there, start = self._stance(joints).feet[leg], self._stance().feet[leg]
            height = there.z + ROCK_ABOVE - terrain.height(there.x, there.y)
            if distance(start, there) > ROCK_ROOM and height <= HIGHEST_ROCK:
                self.plant.add_rock(Rock(there.x, there.y, ROCK_RADIUS, height))
                self._begin(fault)

    def after_move(self) -> bool:
        """What was to go wrong after a move does; whether ground gave way."""
        for fault in self._armed_of(*MACHINE_KINDS):
            self.faults.append(fault)
            self._begin(fault)
        return any(map(self._gives_way, self._armed_of(SOFT_SPOT)[:1]))

    def take_begun(self) -> list[Fault]:
        """Those that have begun since this was asked before."""
        begun, self._begun = self._begun, []
        return begun

    def has(self, kind: str, leg: int) -> bool:
        """Whether a leg has such a fault."""
        return any(fault.kind == kind and fault.leg == leg for fault in self.faults)

    def clear(self, leg: int, *kinds: str, operator: bool = False) -> bool:
        """Mend what a leg has of these kinds; False if only an operator could."""
        mine = [fault for fault in self.faults if fault.leg == leg and fault.kind in kinds]
        stays = [fault for fault in mine if fault.needs_operator and not operator]
        self.faults = [fault for fault in self.faults if fault not in mine or fault in stays]
        return not stays

    def amplifiers(self) -> tuple[bool, ...]:
        """Which legs' amplifiers are on."""
        return tuple(not self.has("amplifier trip", leg) for leg in LEGS)

    def encoder_offsets(self) -> tuple[float, ...]:
        """By how much (m) each leg's relative encoder is off its absolute one."""
        drifts = {
            fault.leg: fault.size or DRIFT
            for fault in reversed(self.faults)
            if fault.kind == "encoder drift"
        }
        return tuple(drifts.get(leg, 0.0) for leg in LEGS)

    # --- the plant --------------------------------------------------------------------------------

    def drive(self, joints: Array, rates: Array) -> None:
        """A leg whose amplifier is off or whose joint is stuck stays where it is: its brakes hold
        it.
        """
        joints, shares = joints - self._offsets(), self._mobility()
        if shares.min() < 1.0:
            now = self.plant.joints()
            joints, rates = (
                np.where(shares < 1.0, now + shares * (joints - now), joints),
                shares * rates,
            )
        self.plant.drive(joints, rates)

    def joints(self) -> Array:
        """As the relative encoders have it."""
        joints: Array = self.plant.joints() + self._offsets()
        return joints

    def loads(self) -> Array:
        """A force sensor that is broken says NaN."""
        loads = self.plant.loads()
        for fault in self.faults:
            if fault.kind == "force sensor":
                loads[fault.leg] = np.nan
        return loads

    def cast(self, origin: Array, directions: Array, limit: float) -> Array:
        """The next images after a scanner's fault have nothing, or anything, in them."""
        distances = self.plant.cast(origin, directions, limit)
        for fault in self.faults:
            if fault.kind in SCANNER_KINDS:
                self.faults.remove(fault)
                if fault.size > 1:
                    self.faults.append(Fault(fault.kind, fault.leg, fault.size - 1))
                if fault.kind == "no image":
                    return np.full_like(distances, np.nan)
                garbage: Array = 0.5 + np.mod(np.arange(len(distances)) * 0.618, 1.0) * limit
                return garbage
        return distances

    def _armed_of(self, *kinds: str) -> list[Fault]:
        return [fault for fault in self.armed if fault.kind in kinds]

    def _begin(self, fault: Fault) -> None:
        self.armed.remove(fault)
        self._begun.append(fault)

    def _gives_way(self, fault: Fault) -> bool:
        """The ground under the fault's leg falls in, or under the next one that is not needed, nor
        those around it.
        """
        stance, loads = self._stance(), self.loads()
        for leg in (*LEGS[fault.leg :], *LEGS[: fault.leg]):
            middle = stance.feet[leg]
            falling = [foot.leg for foot in stance.feet if distance(middle, foot) < HOLE_RADIUS]
            if not (loads < HANGING_LOAD).any() and support_margin(stance, *falling) > SPARED:
                self.plant.give_way(middle.x, middle.y)
                self._begin(fault)
                return True
        return False

    def _stance(self, joints: Array | None = None) -> Stance:
        """Where body and feet really are, or would be with these joints."""
        return stance_of(
            self.plant.attitude().pose, self.plant.joints() if joints is None else joints
        )

    def _mobility(self) -> Array:
        """The share of its speed that each leg has left, (6, 1)."""
        left = [
            0.0
            if self.has("amplifier trip", leg) or self.has("stuck joint", leg)
            else LAG
            if self.has("motion fault", leg)
            else 1.0
            for leg in LEGS
        ]
        return np.array(left)[:, None]

    def _offsets(self) -> Array:
        offsets = np.zeros((len(LEGS), 3))
        offsets[:, 1] = self.encoder_offsets()
        return offsets
