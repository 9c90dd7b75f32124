"""Models with random faults. Each model is rejected with the line of its fault, or its components
run and can be drawn.
"""

import tomllib
from copy import deepcopy
from pathlib import Path
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from tca_behaviours.activities.components import initialise
from tca_behaviours.activities.models.code import (
    application_module,
    component_module,
    generated_module,
)
from tca_behaviours.activities.models.dot import model_dot
from tca_behaviours.activities.models.reading import model_of
from tca_tools.errors import BadUserFile

TABLES = tomllib.loads((Path(__file__).parent / "cleaning.toml").read_text())
WORDS = (
    "", "x", "panel", "Joint", "Target", "position", "target", "moving", "stopped", "fast", "enabling.enabled", "move",
    "search", "tell", "self", "region", "name", "data", "float", "int", "class", "going home", 'a"b', "a\\", "é", "Any",
    "List", "collections:Counter", "x.target", "take_target", "machine", "states", "Callable", "dataclass",
)  # fmt: skip
VALUES: list[Any] = [
    *WORDS,
    0,
    1,
    -1,
    0.5,
    10**30,
    float("inf"),
    float("nan"),
    True,
    [],
    ["x"],
    {},
    {"type": "str"},
]


def keys_of(node: Any) -> list[Any]:
    if isinstance(node, dict):
        return list(node)
    return list(range(len(node))) if isinstance(node, list) else []


def places(node: Any) -> list[tuple[Any, Any]]:
    """Return all containers of a model, each with each of its keys."""
    keys = keys_of(node)
    return [(node, key) for key in keys] + [place for key in keys for place in places(node[key])]


@st.composite
def faulty(draw: st.DrawFn) -> dict[str, Any]:
    tables = deepcopy(TABLES)
    for _ in range(draw(st.integers(1, 2))):
        node, key = draw(st.sampled_from(places(tables)))
        alike = [
            where[other] for where, other in places(TABLES) if type(where[other]) is type(node[key])
        ]
        match draw(st.integers(0, 7)):
            case 0:
                del node[key]
            case 1 if isinstance(node, dict):
                node[draw(st.sampled_from(WORDS))] = node.pop(key)
            case 2 if isinstance(node, dict):
                node[draw(st.sampled_from(WORDS))] = deepcopy(node[key])
            case 3:
                node[key] = deepcopy(draw(st.sampled_from(VALUES)))
            case _:
                node[key] = deepcopy(draw(st.sampled_from(alike)))
    return tables


@settings(max_examples=60)
@given(faulty())
def test_random_model_is_rejected_or_runs(tables: dict[str, Any]) -> None:
    try:
        model = model_of("cleaning", tables)
    except BadUserFile:
        return
    assert model_dot(model)
    compile("\n".join(application_module(model, "")), "application.py", "exec")
    modules = [
        generated_module(model),
        *(component_module(model, name, "") for name in model.components),
    ]
    names: dict[str, Any] = {"__name__": "generated"}
    for module in modules:
        ours = "\n".join(line for line in module if not line.startswith("from generated"))
        exec(compile(ours, "module.py", "exec", dont_inherit=True), names)
    made = [names[name]("x") for name in model.components]
    for component in made:
        assert component.activities() or not (component.inputs or component.regions)
    initialise(made)
