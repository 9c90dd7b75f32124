"""The coordinator of the delivery, and its program."""

from robots.options import program_parser
from robots.youbot_sim.delivery import make_delivery
from tca_behaviours.coordination import Coordinator
from tca_behaviours.coordination.preview.policy import Candidate, Discrete
from tca_module import Module

THRESHOLD = 0.5
"""The least probability with which an arm move is begun early."""


def likelihood(candidate: Candidate) -> float:
    """Return the value of an early arm move: the probability that the move is needed. The progress
    of the base does not count.
    """
    return candidate.probability


def make_coordinator(*, has_preview: bool = True) -> Coordinator:
    """Make a coordinator. Without a preview it does nothing early."""
    return Coordinator(
        make_delivery(), policy=Discrete(THRESHOLD, likelihood) if has_preview else None
    )


def make_module(coordinator: Coordinator) -> Module:
    """Make the module that runs a delivery."""
    module = Module("coordinator")
    coordinator.handle_in(module)
    return module


def main() -> None:
    """Run the coordinator's program."""
    parser = program_parser("youbot_sim.coordination", __doc__)
    parser.add_argument(
        "--plain", action="store_true", help="without a preview: nothing is done ahead"
    )
    make_module(make_coordinator(has_preview=not parser.parse_args().plain)).run()


if __name__ == "__main__":
    main()
