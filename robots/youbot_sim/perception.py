"""Perception: looks into box B, and publishes how sure it is that the box is free.

The confidence does not change at once. Each look moves it half-way to the observed state.
"""

from robots.youbot_sim.messages import BOX_B_FREE, LOOK
from tca_module import Callback, Module

PERIOD = 0.2
"""Seconds between two looks."""

CERTAIN = 0.05
"""The distance from 0 or 1 below which a confidence becomes 0 or 1."""


def updated_confidence(confidence: float | None, *, is_free: bool) -> float:
    """Return the confidence after a look; *confidence* is None before the first one."""
    seen = float(is_free)
    if confidence is None or abs(seen - confidence) / 2 < CERTAIN:
        return seen
    return (confidence + seen) / 2


def make_module() -> Module:
    """Make the module."""
    perception = Module("perception")
    published: list[float] = []

    @perception.every(PERIOD)
    def look(callback: Callback) -> None:
        confidence = updated_confidence(
            published[-1] if published else None, is_free=callback.query(LOOK)
        )
        if published != [confidence]:
            published[:] = [confidence]
            callback.set_variable(BOX_B_FREE, confidence, wait=False)

    return perception


if __name__ == "__main__":
    make_module().run()
