"""Faults of the machine and its sensors, on any plant: what goes wrong, until when, and how that shows.

A plant is wrapped: what is commanded and what is measured passes through here. A fault is armed first; it begins when
the next move is over.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from robots.ambler_sim.geometry import Array
from robots.ambler_sim.machine.plant import Attitude, Plant
from robots.ambler_sim.vocabulary import LEGS, Fault, Foot, Rock

LAG = 0.25
"""The share of its speed that a joint with a motion fault has left."""

DRIFT = 0.08
"""Metres that a drifting encoder is off, unless the fault says how much."""

MACHINE_KINDS = ("amplifier trip", "motion fault", "stuck joint", "encoder drift", "force sensor")
SCANNER_KINDS = ("no image", "bad image")


class FaultyPlant:
    """A plant with faults."""

    def __init__(self, plant: Plant, faults: Sequence[Fault] = ()) -> None:
        self.plant = plant
        self.name, self.tick = plant.name, plant.tick
        self.faults: list[Fault] = list(faults)
        self._armed: list[Fault] = []

    # --- what goes wrong ---------------------------------------------------------------------------------------------

    def arm(self, fault: Fault) -> None:
        """It begins after the next move; those of the scanner at once."""
        (self.faults if fault.kind in SCANNER_KINDS else self._armed).append(fault)

    def begin_armed(self) -> None:
        """A move is over."""
        self.faults += self._armed
        self._armed.clear()

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
        return tuple(
            next(
                (fault.size or DRIFT for fault in self.faults if (fault.kind, fault.leg) == ("encoder drift", leg)), 0.0
            )
            for leg in LEGS
        )

    # --- the plant ---------------------------------------------------------------------------------------------------

    def drive(self, joints: Array, rates: Array) -> None:
        """A leg whose amplifier is off or whose joint is stuck stays where it is: its brakes hold it."""
        if any(fault.kind in MACHINE_KINDS for fault in self.faults):
            offsets = self._offsets()
            joints, now = joints - offsets, self.plant.joints()
            for leg in LEGS:
                if self.has("amplifier trip", leg) or self.has("stuck joint", leg):
                    joints[leg], rates = now[leg], _slowed(rates, leg, 0.0)
                elif self.has("motion fault", leg):
                    joints[leg] = now[leg] + LAG * (joints[leg] - now[leg])
                    rates = _slowed(rates, leg, LAG)
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

    def pushes(self) -> Array:
        """The horizontal forces on the feet."""
        return self.plant.pushes()

    def bumps(self) -> Array:
        """The forces on links and body."""
        return self.plant.bumps()

    def attitude(self) -> Attitude:
        """Position and inclination of the body."""
        return self.plant.attitude()

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

    def add_rock(self, rock: Rock) -> None:
        """A rock that the scanner does not see."""
        self.plant.add_rock(rock)

    def give_way(self, x: float, y: float) -> None:
        """The ground falls in, and with it the foot that stands there."""
        self.plant.give_way(x, y)

    def picture(self, path: Path, trail: Sequence[Foot], size: tuple[int, int]) -> Path:
        """Draw robot, ground and footprints."""
        return self.plant.picture(path, trail, size)

    def close(self) -> None:
        """Free what the simulator holds."""
        self.plant.close()

    def _offsets(self) -> Array:
        offsets = np.zeros((len(LEGS), 3))
        offsets[:, 1] = self.encoder_offsets()
        return offsets


def _slowed(rates: Array, leg: int, share: float) -> Array:
    rates = rates.copy()
    rates[leg] *= share
    return rates
