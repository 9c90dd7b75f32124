"""Explores every interleaving of a small scenario against the real core of central: bounded model checking."""

from tca_explorer.errors import ExplorerError, ScenarioError
from tca_explorer.observed.world import Held, Seen, World
from tca_explorer.scenario.accepted import accepted
from tca_explorer.scenario.scenario import Scenario, ScenarioModule
from tca_explorer.scenario.script import Script, Task
from tca_explorer.search.exploration import explore
from tca_explorer.search.states import Result, Violation
from tca_explorer.search.transcript import report
from tca_properties import (
    BadProperty,
    Property,
    achieved,
    always,
    at_most,
    at_most_in_all,
    before,
    begun,
    being_achieved,
    eventually,
    failed,
    fired,
    handled,
    handled_by,
    killed,
    never,
    never_stuck,
    planned,
    planned_ahead,
    queued,
    recovering,
    retried,
    sent,
    suspended,
    within,
)

__all__ = [
    "BadProperty",
    "ExplorerError",
    "Held",
    "Property",
    "Result",
    "Scenario",
    "ScenarioError",
    "ScenarioModule",
    "Script",
    "Seen",
    "Task",
    "Violation",
    "World",
    "accepted",
    "achieved",
    "always",
    "at_most",
    "at_most_in_all",
    "before",
    "begun",
    "being_achieved",
    "eventually",
    "explore",
    "failed",
    "fired",
    "handled",
    "handled_by",
    "killed",
    "never",
    "never_stuck",
    "planned",
    "planned_ahead",
    "queued",
    "recovering",
    "report",
    "retried",
    "sent",
    "suspended",
    "within",
]
