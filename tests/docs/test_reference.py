"""The reference describes every public name once, and every parameter, return and default."""

import ast
import importlib
import inspect
import re
from collections.abc import Callable
from operator import attrgetter
from types import ModuleType

import griffe
import pytest

import tca_module
from dev.site.parts import PARTS_BY_NAME
from docs.reference import described, shown, sources
from tca_module import Client, Module
from tca_module.sending.sender import TaskOptions
from tca_module.sending.watching import MonitorOptions
from tca_module.serving.handler_options import HandlerOptions
from tca_tools.export.tables import TABLES

SHARED = "UnsoundMachine"
"""The name that several packages export, and one page describes."""
MODULES = {
    "tca_module": "",
    "tca_tools.explore": "explorer",
    "tca_behaviours.missions": "missions",
    "tca_behaviours.missions.charts": "state-machines",
    "tca_behaviours.coordination": "coordination",
    "tca_behaviours.activities": "activities",
    "tca_behaviours.activities.components": "activities",
    "tca_behaviours.activities.manager": "activities",
}
"""The public modules, and the pages that describe them ("": several)."""
OTHERS = ["tca_module.testing.LocalCentral", "tca_module.rig.Fake"]
"""Public names of modules that also have other names."""


def public_names(module: ModuleType) -> list[str]:
    names = getattr(module, "__all__", None) or [
        name
        for name, one in vars(module).items()
        if not name.startswith("_") and not inspect.ismodule(one)
    ]
    is_elsewhere = module.__name__ in (
        "tca_behaviours.coordination",
        "tca_behaviours.activities.components",
    )
    return [
        name
        for name in names
        if not is_of_library(module, name) and not (name == SHARED and is_elsewhere)
    ]


def is_of_library(module: ModuleType, name: str) -> bool:
    """Whether a name of another package is exported again: the library's page describes it."""
    return (
        module is not tca_module
        and name in tca_module.__all__
        and (getattr(module, name) is getattr(tca_module, name))
    )


@pytest.mark.parametrize("module", MODULES)
def test_each_public_name_stands_on_one_page(module: str) -> None:
    page = MODULES[module]
    found = [one.name for one in described() if one.page == page or not page]
    if not page:
        own = [one for one in described() if one.path.startswith("tca_module.")]
        rows = [
            one for one in described() if "." not in one.path and one.page not in MODULES.values()
        ]
        found = [one.name for one in (*own, *rows)]
    names = public_names(importlib.import_module(module))
    assert {name: found.count(name) for name in names if found.count(name) != 1} == {}


def test_names_of_test_modules_stand_on_their_page() -> None:
    assert [one for one in OTHERS if one not in [each.path for each in described()]] == []


def test_members_that_pages_list_exist() -> None:
    """An unquoted ``on`` would be true, for example."""
    missing = []
    for one in described():
        for option in ("members", "inherited_members"):
            wanted = one.options.get(option)
            if isinstance(wanted, list):
                known = sources()[one.path].all_members
                missing += [f"{one.path}: {name}" for name in wanted if name not in known]
    assert missing == []


def members() -> list[griffe.Object]:
    """Return all objects that the site shows, each once."""
    directives = [
        one for one in described() if "." in one.path and one.options.get("show_signature", True)
    ]
    found = {one.path: one for each in directives for one in shown(each)}
    return list(found.values())


def callables() -> list[griffe.Function]:
    found = [getattr(one, "final_target", one) for one in members()]
    return [one for one in found if isinstance(one, griffe.Function)]


def sections(one: griffe.Object, kind: str) -> list[griffe.DocstringSection]:
    assert one.docstring is not None, one.path
    return [each for each in one.docstring.parsed if each.kind.value == kind]


def test_each_parameter_is_described() -> None:
    missing = []
    for one in callables():
        texts = [
            each.name.lstrip("*") for part in sections(one, "parameters") for each in part.value
        ]
        names = [each.name for each in one.parameters]
        wanted = [name for name in names if name not in ("self", "cls") and name[0] != "_"]
        missing += [f"{one.path}: {name}" for name in wanted if name not in texts]
    assert missing == []


def test_each_return_is_described() -> None:
    """A docstring that starts with "Return" describes it; so does a section."""
    missing = []
    for one in callables():
        text = one.docstring.value if one.docstring is not None else ""
        returns = str(one.returns or "None")
        is_described = sections(one, "returns") or sections(one, "yields")
        starts = text.startswith(("Return", "Yield", "Whether", "Declare"))
        if returns not in ("None", "NoReturn") and not (is_described or starts):
            missing.append(f"{one.path}: {returns}")
    assert missing == []


# --- options ----------------------------------------------------------------------------------------


OPTIONS = {
    Client.command: TaskOptions,
    Client.execute_if_handled: TaskOptions,
    Client.monitor: MonitorOptions,
    Module.handles: HandlerOptions,
    Module.serve: HandlerOptions,
    Module.handles_on_loop: HandlerOptions,
    tca_module.AsyncClient.goal: TaskOptions,
}


@pytest.mark.parametrize("method", OPTIONS, ids=lambda one: one.__qualname__)
def test_signature_names_all_options(method: object) -> None:
    parameters = inspect.signature(method).parameters  # type: ignore[arg-type]
    options = {name for name, one in parameters.items() if one.kind is one.KEYWORD_ONLY}
    assert options >= OPTIONS[method].__annotations__.keys()  # type: ignore[index]


def test_signature_of_command_has_the_default_of_deadline() -> None:
    deadline = inspect.signature(Client.command).parameters["deadline"]
    assert (deadline.annotation, deadline.default) == (float | None, None)


@pytest.mark.parametrize("typed", [TaskOptions, MonitorOptions, HandlerOptions])
def test_default_of_an_option_is_that_of_its_docstring(typed: type) -> None:
    constructor = sources()[f"{typed.__module__}.{typed.__qualname__}"].members["__init__"]
    texts = {one.name: one.docstring.value for one in constructor.parameters if one.docstring}
    meant = {"None": None, "True": True, "False": False, "none": (), "0": 0, "1": 1}
    for name, hint in typed.__annotations__.items():
        said = texts[name].partition("Default: ")[2].split(". ")[0].split(",")[0].rstrip(".")
        if said in meant:
            assert hint.__metadata__[1] == meant[said], name


def test_help_of_a_call_names_its_options() -> None:
    assert "deadline: float | None = None" in str(inspect.signature(Client.goal))


# --- generated parts --------------------------------------------------------------------------------


def test_part_names_every_table_and_column() -> None:
    text = PARTS_BY_NAME["export-tables"]()
    for table in TABLES:
        part = text.split(f"### {table.name}\n", 1)[1].split("\n### ", 1)[0]
        assert [column for column in table.columns if f"`{column}`" not in part] == []


@pytest.mark.parametrize("part", ["failures", "errors"])
def test_each_failure_has_a_cause_and_a_remedy(part: str) -> None:
    rows = PARTS_BY_NAME[part]().splitlines()[2:]
    assert [row for row in rows if any(not cell.strip() for cell in row.split("|")[1:-1])] == []


def test_each_key_of_a_robot_has_a_meaning() -> None:
    rows = [row for row in PARTS_BY_NAME["robot-toml"]().splitlines() if row.startswith("| `")]
    assert [row for row in rows if row.endswith("|  |")] == []


def test_types_in_signatures_are_exported() -> None:
    """Type variables are not: they have one letter, or name a decorated function."""
    used = {
        name.canonical_path
        for one in members()
        if one.path.startswith("tca_module.") and not one.path.startswith(TESTING)
        for hint in hints(getattr(one, "final_target", one))
        for name in hint.iterate(flat=True)
        if isinstance(name, griffe.ExprName) and name.canonical_path.startswith("tca_")
    }
    names = {path.rpartition(".")[2] for path in used}
    assert {name for name in names if len(name) > 1} - {*tca_module.__all__, "Start"} == set()


TESTING = ("tca_module.testing", "tca_module.rig")


def hints(one: griffe.Object) -> list[griffe.Expr]:
    """Return the annotations of an object."""
    found: list[object] = []
    if isinstance(one, griffe.Function):
        found = [one.returns, *(each.annotation for each in one.parameters)]
    elif isinstance(one, griffe.Attribute):
        found = [one.annotation]
    return [hint for hint in found if isinstance(hint, griffe.Expr)]


# --- examples ---------------------------------------------------------------------------------------

CODE = re.compile(r"```python\n(?P<code>.*?)```", re.DOTALL)
MOST_USED = [
    "connect",
    "aconnect",
    "goal",
    "command",
    "query",
    "multi_query",
    "inform",
    "broadcast",
    "set_variable",
    "get_variable",
    "lock",
    "monitor",
    "tap",
    "on_failure",
    "handles",
    "every",
    "after",
    "run",
    "running",
    "wait",
    "result",
    "cancel",
    "update",
    "kill",
    "report",
    "sequence",
    "parallel",
    "constrain",
    "sleep",
    "deadline",
]


def examples() -> list[tuple[griffe.Object, ast.Module]]:
    return [
        (one, ast.parse(found["code"]))
        for one in members()
        if one.docstring is not None
        for found in CODE.finditer(one.docstring.value)
    ]


def test_most_used_calls_have_an_example() -> None:
    known = {one.name for one, _ in examples()}
    assert [name for name in MOST_USED if name not in known] == []


def test_calls_in_examples_fit_the_signature() -> None:
    """An example of a method or function calls it with arguments that it has."""
    wrong = []
    for one, tree in examples():
        target = getattr(one, "final_target", one)
        if not isinstance(target, griffe.Function):
            continue
        method = attrgetter(target.path.removeprefix(f"{target.module.path}."))(
            importlib.import_module(target.module.path)
        )
        is_bound = "self" in target.parameters
        for call in ast.walk(tree):
            if isinstance(call, ast.Call) and name_of(call) == target.name:
                given = [None] * (len(call.args) + is_bound)
                named = {each.arg: None for each in call.keywords if each.arg}
                try:
                    inspect.signature(method).bind(*given, **named)
                except TypeError as error:
                    wrong.append(f"{target.path}: {ast.unparse(call)}: {error}")
    assert wrong == []


def name_of(call: ast.Call) -> str:
    if isinstance(call.func, ast.Attribute):
        return call.func.attr
    return call.func.id if isinstance(call.func, ast.Name) else ""


@pytest.mark.parametrize("call", [Client.goal, Client.monitor, Client.tap, Module.handles])
def test_help_describes_each_option(call: Callable[..., object]) -> None:
    options = [
        name
        for name, one in inspect.signature(call).parameters.items()
        if one.kind is one.KEYWORD_ONLY
    ]
    described = inspect.getdoc(call) or ""
    assert [name for name in options if f"\n    {name}: " not in described] == []
    assert "see ``" not in described.partition("Returns:")[0]
