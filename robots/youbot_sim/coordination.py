"""The coordinator of the delivery, and its program."""

import argparse

from robots.youbot_sim.delivery import make_delivery
from tca_behaviours.coordination import Coordinator
from tca_behaviours.coordination.preview.policy import Candidate, Discrete
from tca_module import Module

THRESHOLD = 0.5


def likelihood(candidate: Candidate) -> float:
    """The value of an arm move is the probability that it is needed, whenever it begins."""
    return candidate.probability


def make_coordinator(*, has_preview: bool = True) -> Coordinator:
    """Make a coordinator with a preview, or for the plain machine."""
    return Coordinator(
        make_delivery(), policy=Discrete(THRESHOLD, likelihood) if has_preview else None
    )


def make_module(coordinator: Coordinator) -> Module:
    """The module that runs a delivery."""
    module = Module("coordinator")
    coordinator.handle_in(module)
    return module


def main() -> None:
    """Run the coordinator's program."""
    parser = argparse.ArgumentParser(
        prog="python -m robots.youbot_sim.coordination", description=__doc__
    )
    parser.add_argument(
        "--plain", action="store_true", help="without a preview: nothing is done ahead"
    )
    make_module(make_coordinator(has_preview=not parser.parse_args().plain)).run()


if __name__ == "__main__":
    main()
