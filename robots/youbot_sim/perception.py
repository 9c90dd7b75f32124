"""Perception: looks into box B, and publishes how sure it is that the box is free.

It does not change its mind at once: each look moves its belief half-way to what it sees.
"""

from robots.youbot_sim.messages import BOX_B_FREE, LOOK
from tca_module import Callback, Module

PERIOD = 0.2
"""Seconds between two looks."""

SURE = 0.05
"""The distance from certainty below which a belief counts as certain."""


def updated_confidence(confidence: float | None, *, is_free: bool) -> float:
    """The confidence after a look; *confidence* is None before the first one."""
    seen = float(is_free)
    if confidence is None or abs(seen - confidence) / 2 < SURE:
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
