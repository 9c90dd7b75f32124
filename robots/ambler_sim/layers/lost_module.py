"""The layer for lost programs: what a module had in hand when it died is done again."""

from robots.ambler_sim.messages import TRAVERSE_ARC
from robots.ambler_sim.recovery import DO_AGAIN, make_layer
from tca_module import Failure, Module

LOST = Failure("module lost")
"""Raised by central: a module died with something in hand; also where it can't be known how far
that had come.
"""

layer = make_layer("lost module")


@layer.at_start
def attach(module: Module) -> None:
    """Whatever is lost of an arc."""
    module.on_failure(LOST, DO_AGAIN, of=TRAVERSE_ARC)


if __name__ == "__main__":
    layer.run()
