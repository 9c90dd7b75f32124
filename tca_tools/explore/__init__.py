"""Bounded model checking: explore every interleaving of a small scenario against central's core."""

from tca_tools.explore.errors import ExplorerError as ExplorerError
from tca_tools.explore.errors import ScenarioError as ScenarioError
from tca_tools.explore.observed.world import Held as Held
from tca_tools.explore.observed.world import Seen as Seen
from tca_tools.explore.observed.world import World as World
from tca_tools.explore.scenario.requests import accepted as accepted
from tca_tools.explore.scenario.scenario import Scenario as Scenario
from tca_tools.explore.scenario.scenario import ScenarioModule as ScenarioModule
from tca_tools.explore.scenario.script import Script as Script
from tca_tools.explore.scenario.script import Task as Task
from tca_tools.explore.search.exploration import explore as explore
from tca_tools.explore.search.states import Result as Result
from tca_tools.explore.search.states import Violation as Violation
from tca_tools.explore.search.transcript import report as report
from tca_tools.properties import *  # noqa: F403 - properties are stated here as everywhere
