"""Coordination of a robot's activities by a state machine that looks ahead."""

from tca_behaviours.coordination.learning import count_transitions
from tca_behaviours.coordination.model.activities import Activity, Agent, Do
from tca_behaviours.coordination.model.automaton import Automaton, FlatAutomaton, LikelyArrow
from tca_behaviours.coordination.model.interpreter import Interpreter, TakenArrow
from tca_behaviours.coordination.model.likelihoods import Learned, LikelihoodModel, Perceived, Prior, Weighted
from tca_behaviours.coordination.model.machine import Coordination
from tca_behaviours.coordination.model.situation import Fact, Situation
from tca_behaviours.coordination.model.states import AuthoredState
from tca_behaviours.coordination.preview.policy import (
    Candidate,
    Continuous,
    Discrete,
    Policy,
    expected_gain,
    progress_only,
)
from tca_behaviours.coordination.preview.walk import PreviewLimits, most_likely
from tca_behaviours.coordination.running.coordinator import Coordinator
from tca_behaviours.coordination.running.messages import COORDINATION_EVENT, CoordinationEnd, MachineEvent
from tca_behaviours.statecharts.states import UnsoundMachine

__all__ = [
    "COORDINATION_EVENT",
    "Activity",
    "Agent",
    "AuthoredState",
    "Automaton",
    "Candidate",
    "Continuous",
    "Coordination",
    "CoordinationEnd",
    "Coordinator",
    "Discrete",
    "Do",
    "Fact",
    "FlatAutomaton",
    "Interpreter",
    "Learned",
    "LikelihoodModel",
    "LikelyArrow",
    "MachineEvent",
    "Perceived",
    "Policy",
    "PreviewLimits",
    "Prior",
    "Situation",
    "TakenArrow",
    "UnsoundMachine",
    "Weighted",
    "count_transitions",
    "expected_gain",
    "most_likely",
    "progress_only",
]
