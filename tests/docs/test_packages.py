"""The names in the tables of the pages of packages exist."""

import builtins
import re
from typing import Any

import pytest
from docs.pages import DOCS, QUOTE, ROOT

import tca_behaviours.activities
import tca_behaviours.activities.components
import tca_behaviours.activities.manager
import tca_behaviours.coordination
import tca_behaviours.missions
import tca_behaviours.missions.charts
import tca_module
import tca_module.testing
import tca_wire.charts
from tca_behaviours.activities import Application, VirtualBaton
from tca_behaviours.activities.components import Component, Region, RegionState
from tca_behaviours.coordination import AuthoredState, Coordination, Coordinator
from tca_behaviours.missions import BaseMission, OnceTask, TaskHandle, TaskServer
from tca_behaviours.missions.charts import MachineState, StateMachine
from tca_module import Client, SentTask, Task
from tca_module.sending.task_requests import TaskRequest

PAGES = sorted((DOCS / "packages").glob("*.md"))
MODULES = (
    tca_module,
    tca_module.testing,
    tca_wire.charts,
    tca_behaviours.missions,
    tca_behaviours.missions.charts,
    tca_behaviours.coordination,
    tca_behaviours.activities,
    tca_behaviours.activities.components,
    tca_behaviours.activities.manager,
)
OWNERS: dict[str, dict[str, Any]] = {
    "activities": {
        "application": Application,
        "baton": VirtualBaton,
        "region": Region,
        "state": RegionState,
        "component": Component,
    },
    "life-cycles": {"sent": SentTask, "user": Client, "task": Task, "request": TaskRequest},
    "missions": {"mission": BaseMission, "drive": TaskHandle},
    "preview-coordination": {"coordinator": Coordinator, "m": Coordination, "state": AuthoredState},
    "state-machines": {"sm": StateMachine, "state": MachineState},
    "task-servers": {"self": OnceTask, "server": TaskServer, "mission": BaseMission},
}
"""The classes of the variables that the tables use, by page."""
INVENTED = {"CartMission", "Pose"}
"""Names that a user's own files would define."""


def known_names(page: str) -> set[str]:
    """Return the public names of the packages, and all words of the programs that a page quotes."""
    names = {*vars(builtins), *(name for module in MODULES for name in vars(module))}
    for found in QUOTE.finditer(page):
        names.update(re.findall(r"\w+", (ROOT / "examples" / found["file"]).read_text()))
    return names


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.stem)
def test_names_on_a_page_of_a_package_exist(path: Any) -> None:
    page = path.read_text()
    names = known_names(page)
    used = re.findall(r"`([^`\n]+)`", re.sub(r"```.*?```", "", page, flags=re.DOTALL))
    classes = {name for code in used for name in re.findall(r"\b[A-Z]\w*[a-z]\w*", code)}
    members = {
        (variable, name)
        for code in used
        for variable, name in re.findall(r"(?<![\w.])([a-z]+)\.((?!py\b)[a-z]\w*)", code)
        if variable in OWNERS[path.stem]
    }
    assert classes - names - INVENTED == set()
    missing = {
        (variable, name)
        for variable, name in members
        if not hasattr(OWNERS[path.stem][variable], name)
        and name not in OWNERS[path.stem][variable].__annotations__
        and name not in names
    }
    assert missing == set()
