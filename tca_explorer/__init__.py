"""Explores every interleaving of a small scenario against the real core of central: bounded model checking."""

from tca_explorer import pure_core  # noqa: F401 - before all that imports central

# isort: split
import tca_properties
from tca_explorer.errors import ExplorerError, ScenarioError
from tca_explorer.observed.world import Held, Seen, World
from tca_explorer.scenario.requests import accepted
from tca_explorer.scenario.scenario import Scenario, ScenarioModule
from tca_explorer.scenario.script import Script, Task
from tca_explorer.search.exploration import explore
from tca_explorer.search.states import Result, Violation
from tca_explorer.search.transcript import report
from tca_properties import *  # noqa: F403 - properties are stated here as everywhere

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
__all__ += tca_properties.__all__
