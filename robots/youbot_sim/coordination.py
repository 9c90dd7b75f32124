"""The coordinator of the delivery."""

from tca_coordination.preview.policy import Candidate, Discrete

from robots.youbot_sim.delivery import make_delivery
from tca_coordination import Coordinator
from tca_module import Module

THRESHOLD = 0.5


def likelihood(candidate: Candidate) -> float:
    """An arm move is worth as much as it is likely to be needed: its time is saved, whenever it begins."""
    return candidate.probability


def make_coordinator(*, has_preview: bool = True) -> Coordinator:
    """With a preview, or the plain machine."""
    return Coordinator(make_delivery(), policy=Discrete(THRESHOLD, likelihood) if has_preview else None)


def make_module(*, has_preview: bool = True) -> Module:
    """The module that runs it."""
    module = Module("coordinator")
    make_coordinator(has_preview=has_preview).handle_in(module)
    return module
