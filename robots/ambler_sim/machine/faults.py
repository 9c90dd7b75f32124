"""Faults of the machine, its sensors and the ground, on any plant: their start, their end and their
effects.

This module wraps a plant: commands and measurements pass through it. A fault is armed first and
begins when it can. Faults of the scanner begin at once. Faults of the machine and soft ground begin
after a move. A rock appears before a move.
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
"""The share of its speed that a joint with a motion fault retains."""

DRIFT = 0.08
"""The error (m) of a drifting encoder, unless the fault has a size."""

ROCK_RADIUS, ROCK_ROOM, ROCK_ABOVE = 0.2, 0.6, 0.15
"""A rock put in the way (m): its radius, least distance from the foot, and height above the way."""

HIGHEST_ROCK = 1.0
"""The greatest height (m) of a rock above the ground around it."""

LEAST_MARGIN_OF_OTHERS = 0.5
"""The least support margin (m) without the legs whose ground gives way. With a smaller margin the
robot would rock.
"""


class FaultyPlant:
    """A plant with faults. It changes the commands to the plant and the measurements from it."""

    def __init__(
        self, plant: Plant, faults: Sequence[Fault] = (), armed: Sequence[Fault] = ()
    ) -> None:
        self.plant = plant
        self.faults = list(faults)
        """The present faults of machine and scanner."""
        self.armed = list(armed)
        """Faults that wait until they can begin."""
        self._begun: list[Fault] = []

    # --- faults -----------------------------------------------------------------------------------

    def arm(self, fault: Fault) -> None:
        """Add a fault, which begins when it can."""
        self.armed.append(fault)
        if fault.kind in SCANNER_KINDS:
            self.faults.append(fault)
            self._begin(fault)

    def before_swing(self, leg: int, swing: Segment, terrain: Terrain) -> None:
        """Begin an armed rock if there is room. The rock stands in the way of a lifted foot, and is
        higher than that way.
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
        """Begin the faults that wait for the end of a move. Returns whether ground gave way."""
        for fault in self._armed_of(*MACHINE_KINDS):
            self.faults.append(fault)
            self._begin(fault)
        return any(map(self._begin_soft_spot, self._armed_of(SOFT_SPOT)[:1]))

    def pop_begun_faults(self) -> list[Fault]:
        """Return the faults that have begun since the last call."""
        begun, self._begun = self._begun, []
        return begun

    def has(self, kind: str, leg: int) -> bool:
        """Return whether a leg has a present fault of this kind."""
        return any(fault.kind == kind and fault.leg == leg for fault in self.faults)

    def clear(self, leg: int, *kinds: str, operator: bool = False) -> bool:
        """Repair a leg's faults of these kinds. Returns False if one of them needs an operator."""
        found = [fault for fault in self.faults if fault.leg == leg and fault.kind in kinds]
        remaining = [fault for fault in found if fault.needs_operator and not operator]
        self.faults = [fault for fault in self.faults if fault not in found or fault in remaining]
        return not remaining

    def amplifiers(self) -> tuple[bool, ...]:
        """Return which legs' amplifiers are on."""
        return tuple(not self.has("amplifier trip", leg) for leg in LEGS)

    def encoder_offsets(self) -> tuple[float, ...]:
        """Return the error (m) of each leg's relative encoder, compared with the absolute
        encoder.
        """
        drifts = {
            fault.leg: fault.size or DRIFT
            for fault in reversed(self.faults)
            if fault.kind == "encoder drift"
        }
        return tuple(drifts.get(leg, 0.0) for leg in LEGS)

    # --- the plant --------------------------------------------------------------------------------

    def drive(self, joints: Array, rates: Array) -> None:
        """Drive the plant. The brakes hold a leg whose amplifier is off or whose joint is stuck."""
        joints, shares = joints - self._offsets(), self._mobility()
        if shares.min() < 1.0:
            now = self.plant.joints()
            joints = np.where(shares < 1.0, now + shares * (joints - now), joints)
            rates = shares * rates
        self.plant.drive(joints, rates)

    def joints(self) -> Array:
        """Return the joint values, as the relative encoders measure them."""
        joints: Array = self.plant.joints() + self._offsets()
        return joints

    def loads(self) -> Array:
        """Return the loads on the feet; NaN from a broken force sensor."""
        loads = self.plant.loads()
        for fault in self.faults:
            if fault.kind == "force sensor":
                loads[fault.leg] = np.nan
        return loads

    def cast(self, origin: Array, directions: Array, limit: float) -> Array:
        """Cast rays. A scanner's fault makes the next images empty or random."""
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

    def _begin_soft_spot(self, fault: Fault) -> bool:
        """Let the ground fall in under the fault's leg. If the robot can't stand without that leg,
        take the next leg that it can spare. Returns False if there is none.
        """
        stance, loads = self._stance(), self.loads()
        for leg in (*LEGS[fault.leg :], *LEGS[: fault.leg]):
            middle = stance.feet[leg]
            sinking = [foot.leg for foot in stance.feet if distance(middle, foot) < HOLE_RADIUS]
            if (
                not (loads < HANGING_LOAD).any()
                and support_margin(stance, *sinking) > LEAST_MARGIN_OF_OTHERS
            ):
                self.plant.give_way(middle.x, middle.y)
                self._begin(fault)
                return True
        return False

    def _stance(self, joints: Array | None = None) -> Stance:
        """Return the true stance; with *joints*, the stance that these joints would give."""
        return stance_of(
            self.plant.attitude().pose, self.plant.joints() if joints is None else joints
        )

    def _mobility(self) -> Array:
        """Return the share of its speed that each leg retains, (6, 1)."""
        shares = np.ones(len(LEGS))
        for leg in LEGS:
            if self.has("amplifier trip", leg) or self.has("stuck joint", leg):
                shares[leg] = 0.0
            elif self.has("motion fault", leg):
                shares[leg] = LAG
        return shares[:, None]

    def _offsets(self) -> Array:
        offsets = np.zeros((len(LEGS), 3))
        offsets[:, 1] = self.encoder_offsets()
        return offsets
