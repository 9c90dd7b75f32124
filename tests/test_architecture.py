"""Who may import whom: the arrows of docs/architecture.md, and the few files that may touch the world."""

import ast
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = ("tca_wire", "tca_central", "tca_module", "tca_tools", "tca_explorer", "robots")
OURS = set(PACKAGES)

MAY_IMPORT = {
    "tca_wire": {"msgspec", "msgpack"},
    "tca_central": {"tca_wire", "msgspec", "zmq", "click"},
    "tca_module": {"tca_wire", "msgspec", "zmq", "click", "rich"},
    "tca_tools": {
        "tca_wire",
        "msgspec",
        "click",
        "graphviz",
        "pygraphviz",
        "jinja2",
        "markupsafe",
        "mcap",
        "perfetto",
        "pyarrow",
        "rich",
        "starlette",
        "textual",
        "uvicorn",
        "vl_convert",
    },
    "tca_explorer": {"tca_central", "tca_module", "tca_wire", "msgspec", "click"},
    "robots": {"tca_module", "tca_wire", "tca_tools", "numpy", "msgspec", "pybullet", "pybullet_data", "click", "rich"},
}
"""Beside the package itself and the standard library."""

ONLY_IN = {
    "zmq": {
        "tca_central/server.py",
        "tca_module/transport.py",
        "tca_module/direct_sockets.py",
        "tca_module/pulse.py",
    },
    "pybullet": {"robots/ambler_sim/physics.py"},
    "perfetto": {"tca_tools/export/trace/packets.py"},
    "mcap": {"tca_tools/export/mcap_file.py"},
    "pyarrow": {"tca_tools/export/parquet_files.py"},
    "starlette": {"tca_tools/view/app.py"},
    "textual": {"tca_tools/replay/app.py", "tca_tools/replay/panes.py"},
    "uvicorn": {"tca_tools/view/__main__.py"},
}
EXCEPTIONS = {("tca_module/testing.py", "tca_central")}  # the real core for users' tests

# Inside central: what a file may import of its own package; nothing runs in a circle. The parts (registry, task_tree,
# agenda, resources, dispatcher) know each other only along these lines; state puts them together.
CENTRAL: dict[str, set[str]] = {
    "__init__": set(),
    "errors": set(),
    "events": set(),
    "resources": set(),
    "registry": {"errors", "events", "resources"},
    "clock": {"errors"},
    "intervals": set(),
    "task_tree": {"errors", "intervals", "registry"},
    "cycles": {"intervals", "task_tree"},
    "holds": {"clock", "cycles", "errors", "intervals", "task_tree"},
    "agenda": {"clock", "errors", "holds", "intervals", "registry", "task_tree"},
    "dispatcher": {"clock", "registry", "resources"},
    "variables": {"errors"},
    "state": {
        "agenda",
        "clock",
        "dispatcher",
        "events",
        "intervals",
        "registry",
        "resources",
        "task_tree",
        "variables",
    },
    "fan_out": {"registry", "state", "whereabouts"},
    "making": {"fan_out", "intervals", "registry", "state", "task_tree"},
    "notices": {"making", "state"},
    "availability": {"errors", "notices", "registry", "state"},
    "direct": {"errors", "registry", "resources", "state"},
    "taps": {"direct", "errors", "intervals", "making", "registry", "state", "task_tree", "watching"},
    "watching": {"clock", "errors", "intervals", "making", "registry", "state", "task_tree"},
    "attaching": {"errors", "registry", "state", "taps", "task_tree", "watching"},
    "failures": {
        "claims",
        "cycles",
        "errors",
        "intervals",
        "making",
        "registry",
        "state",
        "taps",
        "task_tree",
        "watching",
    },
    "control": {"clock", "errors", "failures", "intervals", "making", "registry", "state", "task_tree"},
    "monitors": {
        "clock",
        "errors",
        "failures",
        "intervals",
        "making",
        "registry",
        "state",
        "task_tree",
        "watching",
        "whereabouts",
    },
    "keeping": {"errors", "registry", "state", "task_tree"},
    "whereabouts": {"dispatcher", "holds", "registry", "resources", "state", "task_tree"},
    "load": {"registry", "state", "task_tree", "whereabouts"},
    "status": {"holds", "load", "registry", "state", "task_tree"},
    "requests": {
        "attaching",
        "claims",
        "clock",
        "control",
        "direct",
        "errors",
        "failures",
        "fan_out",
        "intervals",
        "keeping",
        "making",
        "monitors",
        "registry",
        "state",
        "status",
        "taking",
        "taps",
        "task_tree",
        "watching",
        "whereabouts",
    },
    "giving_up": {"availability", "claims", "registry", "resources", "state", "waits", "whereabouts"},
    "waits": {"errors", "intervals", "registry", "state", "task_tree"},
    "stuck": {"cycles", "needs", "state"},
    "needs": {"cycles", "intervals", "registry", "resources", "state", "task_tree", "waits"},
    "taking": {"claims", "failures", "registry", "resources", "state", "task_tree"},
    "deadlocks": {
        "claims",
        "clock",
        "cycles",
        "failures",
        "giving_up",
        "needs",
        "registry",
        "resources",
        "state",
        "stuck",
        "taking",
        "task_tree",
        "whereabouts",
    },
    "claims": {"clock", "direct", "errors", "registry", "resources", "state", "whereabouts"},
    "sharing": {"errors", "fan_out", "registry", "state", "variables"},
    "joining": {
        "claims",
        "direct",
        "errors",
        "events",
        "giving_up",
        "intervals",
        "keeping",
        "monitors",
        "notices",
        "registry",
        "requests",
        "sharing",
        "state",
        "taps",
        "task_tree",
    },
    "core": {
        "attaching",
        "availability",
        "claims",
        "clock",
        "control",
        "deadlocks",
        "direct",
        "errors",
        "events",
        "failures",
        "giving_up",
        "joining",
        "keeping",
        "monitors",
        "registry",
        "requests",
        "sharing",
        "state",
        "taking",
        "taps",
        "waits",
        "task_tree",
    },
    "journal_writer": {"errors"},
    "pulses": {"registry"},
    "server": {"core", "errors", "events", "journal_writer", "pulses"},
    "__main__": {"core", "errors", "journal_writer", "server"},
    "invariants": {
        "availability",
        "clock",
        "control",
        "direct",
        "holds",
        "intervals",
        "registry",
        "state",
        "task_tree",
        "watching",
    },
}


@cache
def imports(path: Path) -> frozenset[str]:
    """Dotted names that a file imports, for types or anything else."""
    found = set()
    tree = ast.parse(path.read_text())
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            assert node.level == 0, f"{path}: relative import"
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return frozenset(found)


def files(package: str) -> list[Path]:
    return sorted((ROOT / package).rglob("*.py"))


@pytest.mark.parametrize("package", PACKAGES)
def test_packages_import_along_the_arrows(package: str) -> None:
    third_party = set().union(*MAY_IMPORT.values()) | {"numpy", "pytest", "hypothesis"}
    for path in files(package):
        name = str(path.relative_to(ROOT))
        for imported in {dotted.split(".")[0] for dotted in imports(path)} & (OURS | third_party):
            allowed = MAY_IMPORT[package] | {package}
            assert imported in allowed or (name, imported) in EXCEPTIONS, f"{name} imports {imported}"
            assert name in ONLY_IN.get(imported, {name}), f"{name} imports {imported}"


def test_files_import_in_no_circle() -> None:
    """Not for types either: who reads one file needs those that it builds on, and never both at once."""
    paths = [path for package in PACKAGES for path in files(package) if path.name != "__init__.py"]
    named = {".".join(path.relative_to(ROOT).with_suffix("").parts): path for path in paths}
    arrows = {
        name: {module for dotted in imports(path) for module in (dotted, dotted.rpartition(".")[0]) if module in named}
        for name, path in named.items()
    }
    TopologicalSorter(arrows).prepare()  # raises CycleError, with the circle


def test_the_parts_of_central_do_not_know_each_other() -> None:
    for path in files("tca_central"):
        own = {dotted.split(".")[1] for dotted in imports(path) if dotted.startswith("tca_central.")}
        assert own <= CENTRAL[path.stem], f"{path.name} imports {own - CENTRAL[path.stem]}"


def test_the_explorer_knows_the_pure_core_only() -> None:
    pure = CENTRAL.keys() - {"journal_writer", "server", "__main__", "__init__"}
    for path in files("tca_explorer"):
        of_central = {dotted.split(".")[1] for dotted in imports(path) if dotted.startswith("tca_central.")}
        assert of_central <= pure, f"{path.name} imports {of_central - pure}"


def test_the_explorer_knows_what_handlers_see_of_the_module_library() -> None:
    """Calls and errors, and nothing that opens sockets or runs threads."""
    seen = {"connection", "errors", "failing", "replies", "request", "sender", "task"}
    for path in files("tca_explorer"):
        of_module = {dotted.split(".")[1] for dotted in imports(path) if dotted.startswith("tca_module.")}
        assert of_module <= seen, f"{path.name} imports {of_module - seen}"


def test_modules_need_no_rich() -> None:
    """Only the screen of one command does; it is an extra."""
    using = {path.name for path in files("tca_module") if any(name.startswith("rich") for name in imports(path))}
    assert using == {"top_screen.py"}


def test_init_files_hold_only_imports() -> None:
    for package in PACKAGES:
        for path in (ROOT / package).rglob("__init__.py"):
            for node in ast.parse(path.read_text()).body:
                is_docstring = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
                is_all = isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
                assert is_docstring or is_all or isinstance(node, ast.Import | ast.ImportFrom), (
                    f"{path}: {ast.unparse(node)}"
                )


def test_no_file_is_too_long() -> None:
    for package in PACKAGES:
        for path in files(package):
            assert len(path.read_text().splitlines()) <= 400, path


def test_nothing_unpickles() -> None:
    """But for the explorer, which copies its plays so: the bytes never leave the process."""
    for package in PACKAGES:
        for path in files(package):
            if path.name == "snapshot.py" and package == "tca_explorer":
                continue
            assert not imports(path) & {"pickle", "marshal", "shelve", "dill", "cloudpickle"}, path
