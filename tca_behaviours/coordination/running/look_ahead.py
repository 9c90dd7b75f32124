"""How a machine looks ahead: the policy and limits of a coordinator, and what is known of its machine beforehand."""

from collections.abc import Callable
from typing import Any

from tca_behaviours.coordination.model.activities import Activity
from tca_behaviours.coordination.model.machine import Coordination
from tca_behaviours.coordination.model.mistakes import Mistakes
from tca_behaviours.coordination.preview.branches import needed_later
from tca_behaviours.coordination.preview.decide import Decision, Present, decide
from tca_behaviours.coordination.preview.policy import Policy
from tca_behaviours.coordination.preview.walk import PreviewLimits


class LookAhead:
    """What is decided at each event of a run."""

    def __init__(
        self, machine: Coordination, policy: Policy, limits: PreviewLimits, tell: Callable[[str], object]
    ) -> None:
        """*tell*: takes what functions raise that only a preview calls, in words."""
        self._machine = machine
        self.mistakes = Mistakes(tell)
        """Takes what functions raise that only a preview calls."""
        self._policy = policy
        self._limits = limits
        self._needed = needed_later(machine)

    def decide(self, present: Present) -> Decision:
        """The states that are foreseen, and what to start and stop."""
        automaton = self._machine.automaton(present.situation, self.mistakes)
        return decide(automaton, present, self._policy, self._needed, self._limits, self.mistakes)

    def data_at(self, activity: Activity, share: float, rank: int, otherwise: str) -> list[Any] | None:
        """The data of an activity's tasks at a share of full speed and a rank; None if it has none. *otherwise*: what
        becomes of it then, in words.
        """
        return self.mistakes.otherwise(None, f"{activity!r} {otherwise}", lambda: activity.data_at(share, rank))
