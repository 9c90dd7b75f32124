"""Perception: looks into box B, and says how sure it is that the box is free.

It does not jump to a conclusion: each look brings it half-way from what it believed to what it
sees.
"""

from robots.youbot_sim.messages import BOX_B_FREE, LOOK
from tca_module import Callback, Module

PERIOD = 0.2
"""Seconds between two looks."""

SURE = 0.05
"""Nearer to certainty than that is certain."""


def believed(confidence: float | None, *, is_free: bool) -> float:
    """The confidence after a look; None: before the first one."""
    seen = float(is_free)
    if confidence is None or abs(seen - confidence) / 2 < SURE:
        return seen
    return (confidence + seen) / 2


def make_module() -> Module:
    """The module."""
    perception = Module("perception")
    told: list[float] = []

    @perception.every(PERIOD)
    def look(callback: Callback) -> None:
        confidence = believed(told[-1] if told else None, is_free=callback.query(LOOK))
        if told != [confidence]:
            told[:] = [confidence]
            callback.set_variable(BOX_B_FREE, confidence, wait=False)

    return perception


if __name__ == "__main__":
    make_module().run()
