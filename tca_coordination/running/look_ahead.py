"""How a machine looks ahead: the policy and limits of a coordinator, and what is known of its machine beforehand."""

from collections.abc import Sequence

from tca_coordination.model.activities import Activity
from tca_coordination.model.automaton import Automaton, LikelyArrow, arrows_of
from tca_coordination.model.machine import Coordination
from tca_coordination.preview.conflicts import needed_later
from tca_coordination.preview.decide import Decision, Present, decide
from tca_coordination.preview.policy import Policy
from tca_coordination.preview.walk import PreviewLimits
from tca_wire.coordination import ActivityKind


class LookAhead:
    """What is decided at each event of a run."""

    def __init__(self, machine: Coordination, policy: Policy, limits: PreviewLimits) -> None:
        self._policy = policy
        self._limits = limits
        self._needed = needed_later(_Structure(machine), machine.states[0].leaf.number)

    def decide(self, automaton: Automaton, present: Present) -> Decision:
        """The states that are foreseen, and what to start and stop."""
        return decide(automaton, present, self._policy, self._needed, self._limits)


class _Structure:
    """A machine without likelihoods: nobody is asked for any before it runs."""

    def __init__(self, machine: Coordination) -> None:
        self._states = machine.states

    def arcs(self, state: int) -> Sequence[LikelyArrow]:
        return [LikelyArrow(arrow.symbol, arrow.target.leaf.number, 0.0) for arrow in arrows_of(self._states[state])]

    def activity(self, state: int) -> Activity | None:
        return self._states[state].activity

    def waits(self, state: int) -> bool:
        return self._states[state].kind is ActivityKind.WAIT
