"""The imports that packages may have: the arrows of docs/contributing/architecture.md, and the few files with
external effects.
"""

import ast
import re
from collections import defaultdict
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = ("tca_wire", "tca_central", "tca_module", "tca_tools", "tca_behaviours", "robots")

MAY_IMPORT = {
    "tca_wire": {"msgspec", "msgpack"},
    "tca_central": {"tca_wire", "msgspec", "zmq", "click"},
    "tca_module": {"tca_wire", "msgspec", "zmq"},
    "tca_tools": {
        "tca_wire", "msgspec", "click", "pygraphviz", "jinja2", "markupsafe", "mcap", "perfetto", "pyarrow", "rich", "starlette",
        "textual", "uvicorn", "vl_convert",
    },
    "tca_tools.properties": {"tca_wire", "msgspec"},
    "tca_tools.live": {"tca_wire", "tca_module", "msgspec", "click", "rich"},
    "tca_tools.supervise": {"tca_module", "tca_wire", "msgspec", "click"},
    "tca_tools.testing": {"tca_module", "tca_wire", "pytest"},
    "tca_tools.explore": {"tca_central", "tca_module", "tca_wire", "msgspec", "click"},
    "tca_behaviours.statecharts": {"tca_module", "tca_tools", "tca_wire", "statemachine"},
    "tca_behaviours.missions": {"tca_module", "tca_wire", "msgspec", "click", "IPython"},
    "tca_behaviours.coordination": {"tca_module", "tca_wire", "msgspec"},
    "tca_behaviours.activities": {"tca_module", "tca_tools", "tca_wire", "msgspec", "click", "starlette", "uvicorn"},
    "robots": {
        "tca_behaviours", "tca_module", "tca_wire", "tca_tools", "numpy", "msgspec", "pybullet", "pybullet_data", "click", "rich",
    },
}  # fmt: skip
"""Allowed besides the package itself and the standard library. A subpackage with its own row obeys
only that.
"""

ONLY_IN = {
    "zmq": {
        "tca_central/shell/authenticator.py",
        "tca_central/shell/bound_socket.py",
        "tca_central/shell/door.py",
        "tca_central/shell/gate.py",
        "tca_central/shell/server.py",
        "tca_module/sockets/curve.py",
        "tca_module/sockets/transport.py",
        "tca_module/sockets/pulse.py",
    },
    "pybullet": {
        "robots/ambler_sim/machine/ground_bodies.py",
        "robots/ambler_sim/machine/physics.py",
        "robots/engine.py",
        "robots/youbot_sim/physics.py",
    },
    "nats": {
        "tca_central/replication/jetstream.py",
        "tca_central/replication/jetstream_bodies.py",
    },
    "statemachine": {"tca_behaviours/statecharts/library.py"},
    "pytest": {"tca_tools/testing/plugin.py"},
    "perfetto": {"tca_tools/export/trace/packets.py"},
    "mcap": {"tca_tools/export/mcap_file.py"},
    "pyarrow": {"tca_tools/export/parquet_files.py"},
    "starlette": {
        "tca_tools/view/app.py",
        "tca_tools/view/guards.py",
        "tca_behaviours/activities/page/app.py",
    },
    "textual": {"tca_tools/replay/app.py", "tca_tools/replay/panes.py"},
    "uvicorn": {"tca_tools/view/served_page.py"},
}
EXCEPTIONS = {
    ("tca_module/testing.py", "tca_central"),  # the real core, for users' tests
    ("tca_tools/check/rerun.py", "tca_central"),  # handles recorded inputs again
    ("tca_tools/live/central.py", "tca_central"),  # the options of the daemon
    ("tca_behaviours/missions/charts/machine.py", "tca_tools"),  # pictures of state machines
    ("tca_behaviours/missions/console/command.py", "tca_tools"),  # options of all commands
    ("tca_behaviours/coordination/learning.py", "tca_tools"),  # journals of earlier runs
    ("tca_behaviours/coordination/model/machine.py", "tca_tools"),
}

# Allowed imports of a subpackage ("room") from its own package. A room is a folder, or a file beside
# the folders.
ROOMS: dict[str, dict[str, set[str]]] = {
    "tca_wire": {
        "points": set(),
        "errors": set(),
        "vocabulary": set(),
        "endpoint": set(),
        "keys": {"endpoint", "errors"},
        "waits": set(),
        "charts": set(),
        "coordination": {"charts"},
        "rules": {"points", "vocabulary"},
        "life_cycles": {"errors", "vocabulary"},
        "constraints": {"points"},
        "packets": {"constraints", "errors", "points", "vocabulary"},
        "messages": {"errors", "life_cycles", "packets", "vocabulary"},
        "journal": {"constraints", "errors", "points", "vocabulary", "waits"},
        "text": {"charts", "constraints", "coordination", "errors", "journal", "messages", "points", "vocabulary", "waits"},
    },
    "tca_tools.properties": {
        "world": set(),
        "field_values": {"world"},
        "predicates": {"field_values", "world"},
        "algebra": {"predicates", "world"},
        "cases": {"algebra", "world"},
        "language": {"algebra", "field_values", "predicates", "world"},
        "__init__": {"algebra", "cases", "language", "predicates", "world"},
    },
    "tca_tools.supervise": {
        "guard": set(),
        "trial_log": set(),
        "robot_file": {"trial_log"},
        "log_file": set(),
        "output": {"log_file"},
        "room": set(),
        "control": set(),
        "restarts": {"robot_file"},
        "programs": {"guard"},
        "supervised": {"guard", "output", "programs", "restarts", "robot_file", "room"},
        "hung": {"supervised"},
        "robot": {"control", "guard", "hung", "programs", "supervised", "output", "robot_file"},
        "command": {"control", "supervised", "output", "robot", "robot_file"},
        "__main__": {"command"},
        "__init__": set(),
    },
    "tca_tools.explore": {
        "errors": set(),
        "observed": set(),
        "scenario": {"errors"},
        "play": {"errors", "observed", "scenario"},
        "search": {"errors", "observed", "play", "scenario"},
        "command": {"errors", "scenario", "search"},
        "__init__": {"errors", "observed", "scenario", "search"},
    },
    "tca_central": {
        "loading": set(),
        "errors": set(),
        "events": set(),
        "model": {"errors", "events", "loading"},
        "order": {"errors", "model"},
        "present": {"events", "model", "order"},
        "state": {"errors", "events", "model", "order", "present"},
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
        "image": {"core", "errors", "model"},
        "inputs": {"events"},
        "shell": {"core", "errors", "events", "image", "inputs", "model"},
        "replication": {"core", "errors", "events", "image", "inputs", "shell"},
        "__main__": {"core", "errors", "loading", "replication", "shell"},
    },
    "tca_behaviours.missions": {
        "outcomes": set(),
        "serving": {"outcomes"},
        "client": {"outcomes"},
        "charts": {"client", "outcomes"},
        "console": {"client"},
        "__init__": {"client", "outcomes", "serving"},
    },
    "tca_behaviours.activities": {
        "components": set(),
        "models": {"components"},
        "central_ports": {"components"},
        "reports": set(),
        "processing": set(),
        "analysis": set(),
        "figures": {"analysis", "processing", "reports"},
        "application": {"analysis", "components", "figures", "processing", "reports"},
        "manager": {"application", "components", "reports"},
        "page": {"manager"},
        "__init__": {"analysis", "application", "processing"},
    },
    "tca_behaviours.statecharts": {
        "states": set(),
        "soundness": {"states"},
        "timers": {"states"},
        "writing": {"states"},
        "library": {"states"},
        "__init__": set(),
    },
    "tca_behaviours.coordination": {
        "model": set(),
        "preview": {"model"},
        "running": {"model", "preview"},
        "learning": set(),
        "__init__": {"learning", "model", "preview", "running"},
    },
    "tca_module": {
        "errors": set(),
        "late_calls": set(),
        "log": set(),
        "period": set(),
        "checks": {"errors"},
        "sockets": {"errors"},
        "large": {"errors", "late_calls"},
        "session": {"errors"},
        "link": {"checks", "errors", "large", "late_calls", "log", "session", "sockets"},
        "following": {"checks", "errors", "link", "log", "session"},
        "sending": {"checks", "errors", "following", "link", "log", "session"},
        "serving": {"checks", "errors", "following", "link", "log", "sending", "session", "sockets"},
        "client": {"checks", "errors", "link", "log", "sending", "session"},
        "asynchronous": {
            "checks", "client", "errors", "following", "link", "sending", "serving", "session",
        },
        "module": {
            "asynchronous", "checks", "errors", "link", "log", "sending", "serving", "session",
        },
        "rig": {"checks", "errors", "link", "module", "sending", "serving"},
        "testing": {"checks", "errors", "module", "rig", "sockets"},
        "__init__": {"asynchronous", "client", "errors", "following", "module", "sending", "serving"},
    },
    "tca_behaviours": {
        "statecharts": set(),
        "missions": {"statecharts"},
        "coordination": {"statecharts"},
        "activities": {"statecharts"},
        "__init__": set(),
    },
    "tca_tools": {
        "errors": set(),
        "user_file": {"errors"},
        "user_toml": {"errors"},
        "properties": set(),
        "live": {"errors", "terminal"},
        "supervise": {"errors", "user_toml"},
        "testing": {"supervise"},
        "explore": {"check", "properties", "user_file"},
        "spans": set(),
        "terminal": set(),
        "output": {"errors"},
        "options": {"journal", "output"},
        "command_line": {"user_toml"},
        "drawing": {"errors", "output", "terminal"},
        "journal": {"errors", "terminal"},
        "explain": {"journal", "spans", "terminal"},
        "analysis": {"journal", "spans", "explain"},
        "log": {"errors", "options", "journal", "terminal"},
        "check": {"journal", "options", "properties", "terminal", "explain", "user_file"},
        "stats": {"analysis", "options", "journal", "spans", "terminal", "explain"},
        "export": {"errors", "log", "options", "output", "journal", "spans", "explain"},
        "gantt": {"drawing", "options", "output", "journal", "spans", "terminal", "explain"},
        "schedule": {"drawing", "errors", "gantt", "options", "output", "journal", "spans", "terminal"},
        "tasktree_viz": {"drawing", "errors", "gantt", "options", "output", "journal", "terminal", "explain"},
        "life_cycle": {"user_file", "drawing", "errors", "options", "output", "journal", "terminal"},
        "replay": {"errors", "log", "options", "journal", "tasktree_viz", "terminal", "explain"},
        "report": {
            "analysis", "errors", "gantt", "options", "output", "journal", "spans", "tasktree_viz", "terminal", "explain",
        },
        "view": {"live", "drawing", "errors", "gantt", "options", "journal", "spans", "tasktree_viz", "explain"},
    },
}  # fmt: skip


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text())


@cache
def nodes(path: Path) -> list[ast.AST]:
    return list(ast.walk(parsed(path)))


@cache
def imports(path: Path) -> frozenset[str]:
    """Return the dotted names that a file imports, even if only for types."""
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
    return sorted((ROOT / package.replace(".", "/")).rglob("*.py"))


def own_row(path: Path) -> set[str]:
    """Return the imports that a file may have, by the row of its subpackage or package."""
    package, *rooms = path.relative_to(ROOT).parts
    return MAY_IMPORT.get(f"{package}.{rooms[0]}") or MAY_IMPORT.get(package, set())


@pytest.mark.parametrize("package", PACKAGES)
def test_packages_import_along_the_arrows(package: str) -> None:
    known = set().union(*MAY_IMPORT.values(), PACKAGES, {"pytest", "hypothesis"})
    for path in files(package):
        name = str(path.relative_to(ROOT))
        for imported in {dotted.split(".")[0] for dotted in imports(path)} & known:
            allowed = own_row(path) | {package}
            assert imported in allowed or (name, imported) in EXCEPTIONS, (
                f"{name} imports {imported}"
            )
            assert name in ONLY_IN.get(imported, {name}), f"{name} imports {imported}"


def test_source_files_have_no_import_cycle() -> None:
    """Imports for types count, too. Each file must be readable after the files that it uses."""
    paths = [path for package in PACKAGES for path in files(package) if path.name != "__init__.py"]
    named = {".".join(path.relative_to(ROOT).with_suffix("").parts): path for path in paths}
    arrows = {
        name: {
            module
            for dotted in imports(path)
            for module in (dotted, dotted.rpartition(".")[0])
            if module in named
        }
        for name, path in named.items()
    }
    TopologicalSorter(arrows).prepare()  # raises CycleError with the cycle


def room(package: str, path: Path) -> str:
    inside = path.relative_to(ROOT / package.replace(".", "/"))
    return inside.parts[0].removesuffix(".py")


@pytest.mark.parametrize("package", ROOMS)
def test_subpackages_import_along_the_arrows(package: str) -> None:
    TopologicalSorter(ROOMS[package]).prepare()
    for path in files(package):
        inside = [
            dotted.removeprefix(f"{package}.")
            for dotted in imports(path)
            if dotted.startswith(f"{package}.")
        ]
        own = {dotted.split(".")[0] for dotted in inside}
        here = room(package, path)
        allowed = ROOMS[package].get(here, set()) | {here}
        assert own <= allowed, f"{path} imports {own - allowed}"


@pytest.mark.parametrize("package", ["tca_central", "tca_module", "tca_tools", "tca_wire"])
def test_architecture_picture_orders_subpackages_by_imports(package: str) -> None:
    page = (ROOT / "docs/contributing/architecture.md").read_text(encoding="utf-8").splitlines()
    heads = next(line for line in page if line.startswith("tca_central  "))
    starts = [*(found.start() for found in re.finditer(r"\S+", heads)), None]
    column = heads.split().index(package)
    first = page.index(heads) + 2
    below = page[first : page.index("```", first)]
    heights = {
        room: -height
        for height, line in enumerate(below)
        for room in line[starts[column] : starts[column + 1]].replace("·", " ").split()
    }
    assert len(heights) > 10
    for room, height in heights.items():
        assert all(heights.get(lower, -99) < height for lower in ROOMS[package][room]), room


def test_explorer_imports_the_pure_core_only() -> None:
    for path in files("tca_tools.explore"):
        of_central = {
            dotted.split(".")[1] for dotted in imports(path) if dotted.startswith("tca_central.")
        }
        assert not of_central & {"shell", "__main__"}, path


def test_live_commands_import_rich_for_screens_only() -> None:
    using = {
        path.name
        for path in files("tca_tools.live")
        if any(name.startswith("rich") for name in imports(path))
    }
    assert using == {"top_screen.py"}


def test_message_classes_are_named_in_few_files() -> None:
    """A new message class is a row of traits, a declaration and a route. All other code uses traits
    only.
    """
    naming = {
        str(path.relative_to(ROOT))
        for package in PACKAGES
        for path in files(package)
        if re.search(r"\bMessageClass\.[A-Z]", path.read_text())
    }
    assert naming == {
        "tca_wire/messages/declarations.py",
        "tca_wire/messages/controls.py",
        "tca_central/requests/sending.py",
        "tca_central/state.py",  # the root is a goal
        "tca_tools/journal/fold_records.py",  # unknown earlier messages count as goals
        "tca_tools/log/classic.py",  # its name in the old program
    }


def test_init_files_contain_only_imports() -> None:
    for package in PACKAGES:
        for path in (ROOT / package).rglob("__init__.py"):
            for node in parsed(path).body:
                is_docstring = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
                is_all = isinstance(node, ast.Assign | ast.AugAssign) and ast.unparse(
                    node
                ).startswith("__all__ ")
                assert is_docstring or is_all or isinstance(node, ast.Import | ast.ImportFrom), (
                    f"{path}: {ast.unparse(node)}"
                )


def test_source_files_have_at_most_600_lines() -> None:
    for package in PACKAGES:
        for path in files(package):
            assert len(path.read_text().splitlines()) <= 600, path


def test_test_names_have_at_most_60_characters() -> None:
    for path in (ROOT / "tests").rglob("test_*.py"):
        for name in re.findall(r"^ *(?:async )?def (test_\w+)", path.read_text(), re.MULTILINE):
            assert len(name) <= 60, f"{path}: {name}"


def test_source_code_never_executes_its_input() -> None:
    """The explorer may copy its runs by pickle, because these bytes never leave the process."""
    never = {"pickle", "marshal", "shelve", "dill", "cloudpickle", "jsonpickle", "yaml", "dbm"}
    for package in (*PACKAGES, "dev"):
        for path in files(package):
            is_copying = path == ROOT / "tca_tools/explore/search/snapshot.py"
            assert is_copying or not {dotted.split(".")[0] for dotted in imports(path)} & never, (
                path
            )
            for node in nodes(path):
                called = node.func if isinstance(node, ast.Call) else None
                assert not isinstance(called, ast.Name) or called.id not in (
                    "eval",
                    "exec",
                    "__import__",
                ), path
                assert not isinstance(called, ast.Attribute) or called.attr not in (
                    "recv_pyobj",
                    "send_pyobj",
                ), path


def test_file_names_are_unique() -> None:
    """pytest confuses two files with one name, unless their folders are packages. It then tests
    nothing at all.
    """
    found: dict[str, list[Path]] = defaultdict(list)
    for path in (ROOT / "tests").rglob("test_*.py"):
        if not (path.parent / "__init__.py").exists():
            found[path.name].append(path)
    assert [paths for paths in found.values() if len(paths) > 1] == []
