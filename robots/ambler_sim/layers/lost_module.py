"""The layer for lost modules: the work that a module had when it died is done again."""

from robots.ambler_sim.messages import TRAVERSE_ARC
from robots.ambler_sim.recovery import DO_AGAIN, make_layer
from tca_module import Failure, Module

LOST = Failure("module lost")
"""Raised by central: a module died during its work, perhaps after some of its effects."""

layer = make_layer("lost module")


@layer.at_start
def attach(module: Module) -> None:
    """Attach the recovery to each arc, for any task below it."""
    module.on_failure(LOST, DO_AGAIN, of=TRAVERSE_ARC)


if __name__ == "__main__":
    layer.run()
