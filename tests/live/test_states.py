"""``tca cancel``, ``update`` and ``watch``: what people ask of a running task, and what they hear of its state."""

from dataclasses import dataclass

from tca_module import GENERAL, Command, LifeCycle, Party, Transition, connect, ending
from tca_module.testing import LocalCentral

PAUSABLE = LifeCycle(
    "pausable", [*GENERAL.transitions, Transition("pause", "running", "paused", Party.CLIENT), *ending("paused")]
)


@dataclass
class Grasp:
    width: float


GRASP = Command("grasp", Grasp, result=float, progress=Grasp, life_cycle=PAUSABLE)


def test_what_others_have_declared_can_be_sent_with_its_progress_and_states() -> None:
    with LocalCentral(stepped=True) as central:
        with connect("planner", central) as planner:
            planner.execute_if_handled(GRASP, Grasp(0.1))
            assert planner.declared("grasp").format == GRASP.format
            with connect("user", central) as user:
                assert user.execute(user.declared("grasp"), {"width": 0.1}).info() is not None
