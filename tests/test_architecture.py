"""Who may import whom: the arrows of docs/architecture.md, and the few files that may touch the world. And names: two
classes that have one mean the same.
"""

import ast
import re
from collections import defaultdict
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = (
    "tca_wire", "tca_central", "tca_module", "tca_tools", "tca_properties", "tca_explorer", "tca_live", "tca_run", "tca_bench",
    "tca_missions", "tca_coordination", "tca_activities", "robots",
)  # fmt: skip
OURS = set(PACKAGES)

MAY_IMPORT = {
    "tca_wire": {"msgspec", "msgpack"},
    "tca_central": {"tca_wire", "msgspec", "zmq", "click"},
    "tca_module": {"tca_wire", "msgspec", "zmq"},
    "tca_properties": {"tca_wire", "msgspec"},
    "tca_tools": {
        "tca_properties",
        "tca_wire",
        "msgspec",
        "click",
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
    "tca_live": {"tca_wire", "tca_module", "msgspec", "click", "rich"},
    "tca_run": {"tca_module", "tca_wire", "msgspec", "click"},
    "tca_explorer": {"tca_central", "tca_module", "tca_properties", "tca_wire", "msgspec", "click"},
    "tca_bench": {"tca_module", "tca_wire", "msgspec", "zmq", "click"},
    "tca_missions": {"tca_module", "tca_wire", "msgspec", "click", "statemachine", "IPython"},
    "tca_coordination": {"tca_module", "tca_wire", "msgspec", "statemachine"},
    "tca_activities": {"tca_module", "tca_wire", "msgspec", "click", "starlette", "uvicorn"},
    "robots": {
        "tca_activities",
        "tca_coordination",
        "tca_missions",
        "tca_module",
        "tca_properties",
        "tca_wire",
        "tca_tools",
        "numpy",
        "msgspec",
        "pybullet",
        "pybullet_data",
        "click",
        "rich",
    },
}
"""Beside the package itself and the standard library."""

ONLY_IN = {
    "zmq": {
        "tca_central/shell/authenticator.py",
        "tca_central/shell/door.py",
        "tca_central/shell/gate.py",
        "tca_central/shell/server.py",
        "tca_module/sockets/curve.py",
        "tca_module/sockets/transport.py",
        "tca_module/sockets/direct.py",
        "tca_module/sockets/pulse.py",
        "tca_bench/own/zeromq.py",
        "tca_bench/own/bare.py",
        "tca_bench/own/costs.py",
    },
    "pybullet": {
        "robots/ambler_sim/machine/ground_bodies.py",
        "robots/ambler_sim/machine/physics.py",
        "robots/ambler_sim/machine/window.py",
        "robots/youbot_sim/physics.py",
    },
    "statemachine": {"tca_coordination/model/statechart.py", "tca_missions/charts/statechart.py"},
    "perfetto": {"tca_tools/export/trace/packets.py"},
    "mcap": {"tca_tools/export/mcap_file.py"},
    "pyarrow": {"tca_tools/export/parquet_files.py"},
    "starlette": {"tca_tools/view/app.py", "tca_tools/view/guards.py", "tca_activities/page/app.py"},
    "textual": {"tca_tools/replay/app.py", "tca_tools/replay/panes.py"},
    "uvicorn": {"tca_tools/view/served_page.py"},
}
EXCEPTIONS = {
    ("tca_module/testing.py", "tca_central"),  # the real core for users' tests
    ("tca_tools/check/rerun.py", "tca_central"),  # whose inputs are handled again
    ("tca_missions/charts/machine.py", "tca_tools"),  # pictures of state machines
    ("tca_coordination/learning.py", "tca_tools"),  # journals of earlier runs
    ("tca_coordination/model/machine.py", "tca_tools"),
    ("tca_activities/models/command.py", "tca_tools"),  # pictures of models
    ("tca_activities/page/app.py", "tca_tools"),  # a page beside the viewer's
    ("tca_activities/page/command.py", "tca_tools"),
    ("tca_activities/page/command.py", "tca_live"),
    ("tca_tools/view/steering.py", "tca_live"),  # the page steers a running central as the commands do
}

# What a room of a package may import of its own package. A room is a folder, or a file beside the folders.
ROOMS: dict[str, dict[str, set[str]]] = {
    "tca_wire": {
        "points": set(),
        "errors": set(),
        "vocabulary": set(),
        "endpoint": set(),
        "keys": {"endpoint", "errors"},
        "user_file": set(),
        "user_toml": set(),
        "waits": set(),
        "charts": set(),
        "coordination": set(),
        "rules": {"points", "vocabulary"},
        "life_cycles": {"errors", "vocabulary"},
        "constraints": {"points"},
        "packets": {"constraints", "errors", "points", "vocabulary"},
        "messages": {"errors", "life_cycles", "packets", "vocabulary"},
        "journal": {"constraints", "errors", "points", "vocabulary", "waits"},
        "text": {"constraints", "coordination", "errors", "journal", "messages", "points", "vocabulary", "waits"},
    },
    "tca_properties": {
        "world": set(),
        "field_values": {"world"},
        "predicates": {"field_values", "world"},
        "algebra": {"predicates", "world"},
        "cases": {"algebra", "world"},
        "language": {"algebra", "field_values", "predicates", "world"},
        "__init__": {"algebra", "cases", "language", "predicates", "world"},
    },
    "tca_run": {
        "guard": set(),
        "robot_file": set(),
        "output": set(),
        "room": set(),
        "restarts": {"robot_file"},
        "supervised": {"guard", "output", "restarts", "robot_file", "room"},
        "hung": {"supervised"},
        "robot": {"guard", "hung", "supervised", "output", "robot_file"},
        "command": {"supervised", "output", "robot", "robot_file"},
        "__main__": {"command"},
        "__init__": set(),
    },
    "tca_bench": {
        "processes": set(),
        "contestant": {"processes"},
        "publishing": {"contestant"},
        "cases": {"contestant"},
        "driver": {"cases", "contestant"},
        "running": {"cases", "driver", "processes"},
        "results": {"cases", "running"},
        "table": {"results"},
        "command": {"cases", "results", "running", "table"},
        "__main__": {"command"},
        "own": {"contestant", "processes"},
        "peers": {"contestant", "processes", "publishing"},
        "__init__": set(),
    },
    "tca_explorer": {
        "errors": set(),
        "observed": set(),
        "scenario": {"errors"},
        "play": {"errors", "observed", "scenario"},
        "pure_core": {"errors"},
        "search": {"errors", "observed", "play", "pure_core", "scenario"},
        "command": {"errors", "scenario", "search"},
        "__init__": {"errors", "observed", "pure_core", "scenario", "search"},
    },
    "tca_central": {
        "loading": set(),
        "__init__": {"loading"},
        "errors": set(),
        "events": set(),
        "model": {"errors", "events", "loading"},
        "order": {"errors", "model"},
        "state": {"errors", "events", "model", "order"},
        "needs": {"model", "order", "state"},
        "status": {"errors", "model", "needs", "order", "state"},
        "outgoing": {"errors", "model", "state", "needs"},
        "watching": {"errors", "model", "outgoing", "state"},
        "locks": {"errors", "model", "outgoing", "state", "needs"},
        "failing": {"errors", "locks", "model", "order", "outgoing", "state", "watching"},
        "life_cycles": {"errors", "failing", "model", "state"},
        "control": {"errors", "failing", "locks", "model", "outgoing", "state", "needs", "watching"},
        "requests": {
            "control", "errors", "events", "failing", "life_cycles", "locks", "model", "needs", "outgoing", "state", "watching",
        },
        "deadlock": {"control", "failing", "locks", "model", "needs", "order", "requests", "state"},
        "access": {"errors", "model", "state"},
        "core": {
            "access", "control", "deadlock", "errors", "events", "failing", "life_cycles", "locks", "model", "outgoing", "requests", "state",
            "status", "watching",
        },
        "image": {"control", "core", "errors", "events", "model", "order", "state", "watching"},
        "inputs": {"events"},
        "shell": {"core", "errors", "events", "image", "inputs", "model"},
        "__main__": {"core", "errors", "loading", "shell"},
        "invariants": {"control", "model", "order", "outgoing", "state", "watching"},
    },
    "tca_missions": {
        "outcomes": set(),
        "serving": {"outcomes"},
        "client": {"outcomes"},
        "charts": {"client", "outcomes"},
        "console": {"client"},
        "__init__": {"client", "outcomes", "serving"},
    },
    "tca_activities": {
        "activity": set(),
        "components": {"activity"},
        "models": {"components"},
        "central_ports": {"components"},
        "reports": set(),
        "processing": {"activity"},
        "analysis": set(),
        "figures": {"analysis", "processing", "reports"},
        "application": {"analysis", "components", "figures", "processing", "reports"},
        "manager": {"application", "components", "reports"},
        "page": {"manager"},
        "__init__": {"analysis", "application", "processing"},
    },
    "tca_coordination": {
        "model": set(),
        "preview": {"model"},
        "running": {"model", "preview"},
        "learning": set(),
        "__init__": {"learning", "model", "preview", "running"},
    },
    "tca_module": {
        "errors": set(),
        "log": set(),
        "period": set(),
        "checks": {"errors"},
        "sockets": {"errors"},
        "session": {"errors"},
        "direct": {"errors", "log", "session", "sockets"},
        "link": {"checks", "direct", "errors", "log", "session", "sockets"},
        "following": {"checks", "errors", "link", "log", "session"},
        "sending": {"checks", "errors", "following", "link", "log", "session"},
        "serving": {"checks", "errors", "following", "link", "log", "sending", "session", "sockets"},
        "client": {"checks", "errors", "link", "log", "sending"},
        "module": {"checks", "errors", "link", "log", "sending", "serving", "session"},
        "testing": {"checks", "errors", "sockets"},
        "__init__": {"client", "errors", "following", "module", "sending", "serving"},
    },
    "tca_tools": {
        "errors": set(),
        "spans": set(),
        "terminal": set(),
        "output": {"errors"},
        "options": {"output"},
        "command_line": {"errors"},
        "drawing": {"errors", "output", "terminal"},
        "run": {"errors"},
        "why": {"run", "spans", "terminal"},
        "analysis": {"run", "spans", "why"},
        "log": {"errors", "options", "run", "terminal"},
        "check": {"run", "terminal", "why"},
        "stats": {"analysis", "options", "run", "spans", "terminal", "why"},
        "export": {"errors", "log", "options", "output", "run", "spans", "why"},
        "gantt": {"drawing", "options", "output", "run", "spans", "terminal", "why"},
        "schedule": {"drawing", "errors", "gantt", "options", "output", "run", "spans", "terminal"},
        "tasktree_viz": {"drawing", "errors", "gantt", "options", "output", "run", "terminal", "why"},
        "life_cycle": {"drawing", "errors", "options", "output", "run", "terminal"},
        "replay": {"errors", "log", "options", "run", "tasktree_viz", "terminal", "why"},
        "report": {
            "analysis", "errors", "gantt", "options", "output", "run", "spans", "tasktree_viz", "terminal", "why",
        },
        "view": {"drawing", "errors", "gantt", "options", "run", "tasktree_viz", "why"},
    },
}  # fmt: skip

# Classes of one name, which mean the same: the packages that have one, why each does, and the names.
TWINS = (
    ("tca_explorer tca_wire", "the step of a script, and the packet it sends", "Ask Await Fail GiveUp"),
    ("tca_central tca_explorer tca_module tca_tools", "central's record, the library's object, a script's, a run's",
     "Task"),
    ("tca_central tca_module tca_tools", "central's record, the library's object, the record of a run", "Claim"),
    ("tca_central tca_module", "central's record, the library's object", "Connection Handler Module Observation"),
    ("tca_central tca_wire", "the event, and the cause in the journal", "ConnectionLost"),
    ("tca_central tca_wire", "the event, and the fact", "DiskSpace KeysChanged PermissionsChanged"),
    ("tca_central tca_tools", "the ends of waits, now and in a run", "Ends"),
    ("tca_tools tca_wire", "the record of a run, and what was declared", "Failure Message"),
    ("tca_tools tca_wire", "the record of a run, and the fact", "Failed"),
    ("tca_tools tca_wire", "the record of a run, and the packet that asked for it", "Retry"),
    ("tca_tools tca_tools", "check relies on nobody else's fold", "Hold"),
    ("tca_module tca_wire", "the error, and the packet or fact that tells of it", "Refused Reissued"),
    ("tca_module tca_wire", "the library's object, and the cause in the journal", "Request"),
    ("tca_module tca_wire", "the library's object, and the part of a packet", "Trouble"),
    ("robots robots", "where it is, of a robot with legs and of one that draws", "Pose"),
    ("robots tca_tools", "the task of a turtle, and a wait of a run", "Wait"),
    ("tca_coordination tca_explorer", "how things are at one moment, in a run and in a scenario", "Situation"),
    ("tca_explorer tca_tools", "what is broken, in a scenario and in a run", "Violation"),
    ("tca_wire tca_wire tca_wire tca_wire", "the base of a file's headers", "_Header"),
)  # fmt: skip


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text())


@cache
def nodes(path: Path) -> list[ast.AST]:
    return list(ast.walk(parsed(path)))


@cache
def imports(path: Path) -> frozenset[str]:
    """Dotted names that a file imports, for types or anything else."""
    found = set()
    for node in nodes(path):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            assert node.level == 0, f"{path}: relative import"
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return frozenset(found)


@cache
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


def room(package: str, path: Path) -> str:
    inside = path.relative_to(ROOT / package)
    return inside.parts[0].removesuffix(".py")


@pytest.mark.parametrize("package", ROOMS)
def test_rooms_import_along_the_arrows(package: str) -> None:
    TopologicalSorter(ROOMS[package]).prepare()
    for path in files(package):
        own = {dotted.split(".")[1] for dotted in imports(path) if dotted.startswith(f"{package}.")}
        here = room(package, path)
        allowed = ROOMS[package].get(here, set()) | {here}
        assert own <= allowed, f"{path} imports {own - allowed}"


def test_the_explorer_knows_the_pure_core_only() -> None:
    for path in files("tca_explorer"):
        of_central = {dotted.split(".")[1] for dotted in imports(path) if dotted.startswith("tca_central.")}
        assert not of_central & {"shell", "__main__"}, path


def test_rich_is_for_screens() -> None:
    using = {path.name for path in files("tca_live") if any(name.startswith("rich") for name in imports(path))}
    assert using == {"top_screen.py"}


def test_few_files_name_a_message_class() -> None:
    """A new one is a row of traits, a declaration and a route; all else asks for traits."""
    naming = {str(path.relative_to(ROOT)) for package in PACKAGES for path in files(package)
              if re.search(r"\bMessageClass\.[A-Z]", path.read_text())}  # fmt: skip
    assert naming == {
        "tca_wire/messages/declarations.py",
        "tca_wire/messages/controls.py",
        "tca_central/requests/sending.py",
        "tca_central/state.py",  # the root is a goal
        "tca_tools/run/fold_records.py",  # what was sent before the journal begins counts as a goal
        "tca_tools/log/classic.py",  # as the old program called it
    }


def test_classes_of_one_name_mean_the_same() -> None:
    """One that means something else needs another name. A row whose classes are not there goes."""
    owners: dict[str, list[str]] = defaultdict(list)
    for package in sorted(PACKAGES):
        for path in files(package):
            for node in parsed(path).body:
                if isinstance(node, ast.ClassDef):
                    owners[node.name].append(package)
    twins = {name: " ".join(packages) for name, packages in owners.items() if len(packages) > 1}
    assert twins == {name: packages for packages, _, names in TWINS for name in names.split()}


def test_init_files_hold_only_imports() -> None:
    for package in PACKAGES:
        for path in (ROOT / package).rglob("__init__.py"):
            for node in parsed(path).body:
                is_docstring = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
                is_all = isinstance(node, ast.Assign | ast.AugAssign) and ast.unparse(node).startswith("__all__ ")
                assert is_docstring or is_all or isinstance(node, ast.Import | ast.ImportFrom), (
                    f"{path}: {ast.unparse(node)}"
                )


def test_no_file_is_too_long() -> None:
    for package in PACKAGES:
        for path in files(package):
            assert len(path.read_text().splitlines()) <= 600, path


def test_nothing_runs_what_it_reads() -> None:
    """But for the explorer, which copies its plays by pickle: the bytes never leave the process."""
    never = {"pickle", "marshal", "shelve", "dill", "cloudpickle", "jsonpickle", "yaml", "dbm"}
    for package in (*PACKAGES, "fuzz"):
        for path in files(package):
            is_copying = path == ROOT / "tca_explorer/search/snapshot.py"
            assert is_copying or not {dotted.split(".")[0] for dotted in imports(path)} & never, path
            for node in nodes(path):
                called = node.func if isinstance(node, ast.Call) else None
                assert not isinstance(called, ast.Name) or called.id not in ("eval", "exec", "__import__"), path
                assert not isinstance(called, ast.Attribute) or called.attr not in ("recv_pyobj", "send_pyobj"), path


def test_files_of_tests_have_names_of_their_own() -> None:
    """pytest takes two of one name for the same, unless their folders are packages: then nothing at all is tested."""
    found: dict[str, list[Path]] = defaultdict(list)
    for path in (ROOT / "tests").rglob("test_*.py"):
        if not (path.parent / "__init__.py").exists():
            found[path.name].append(path)
    assert [paths for paths in found.values() if len(paths) > 1] == []
