"""Explores every interleaving of a small scenario against the real core of central: bounded model checking."""

import tca_tools.properties
from tca_tools.explore.errors import ExplorerError, ScenarioError
from tca_tools.explore.observed.world import Held, Seen, World
from tca_tools.explore.scenario.requests import accepted
from tca_tools.explore.scenario.scenario import Scenario, ScenarioModule
from tca_tools.explore.scenario.script import Script, Task
from tca_tools.explore.search.exploration import explore
from tca_tools.explore.search.states import Result, Violation
from tca_tools.explore.search.transcript import report
from tca_tools.properties import *  # noqa: F403 - properties are stated here as everywhere

__all__ = [
    "ExplorerError",
    "Held",
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
    "explore",
    "report",
]
__all__ += tca_tools.properties.__all__
