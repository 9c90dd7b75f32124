"""How a machine looks ahead: the policy and limits of a coordinator, and what is known of its machine beforehand."""

from tca_coordination.model.automaton import Automaton
from tca_coordination.model.machine import Coordination
from tca_coordination.preview.branches import needed_later
from tca_coordination.preview.decide import Decision, Present, decide
from tca_coordination.preview.policy import Policy
from tca_coordination.preview.walk import PreviewLimits


class LookAhead:
    """What is decided at each event of a run."""

    def __init__(self, machine: Coordination, policy: Policy, limits: PreviewLimits) -> None:
        self._policy = policy
        self._limits = limits
        self._needed = needed_later(machine)

    def decide(self, automaton: Automaton, present: Present) -> Decision:
        """The states that are foreseen, and what to start and stop."""
        return decide(automaton, present, self._policy, self._needed, self._limits)
