"""The counterparts in docs/from/tca.md exist. Each name in tables and notes is resolved, and
each link leads to a file.
"""

import configparser
import functools
import inspect
import re
from pathlib import Path

import pytest

import tca_module
from tca_behaviours import missions
from tca_behaviours.missions import charts

ROOT = Path(__file__).parent.parent
PAGE = "\n".join((ROOT / "docs/from" / name).read_text() for name in ("tca.md", "smach.md"))

PACKAGES = (charts, missions, tca_module)

ROWS = [row for row in re.findall(r"^\|(.+)\|$", PAGE, re.MULTILINE) if not set(row) <= set("|- ")]
CELLS = [[cell.strip() for cell in re.split(r"(?<!\\)\|", row)] for row in ROWS]
THEIRS = {
    "$TCA_CENTRAL", "--bind", "--stop", "--stop --keep", "IPC_", "-c", "-t", "SEQ_ACH", "TCM_", "async def", "bytes", "fail", "module lost",
    "raise COLLISION(height)", "release()", r"reply=Pose \| None", "tca", "tca_module", "timeout", "unlock", "with",
    "x_ipc", 'takes=["cancel_goal"]', "LocalCentral", "tca_behaviours.missions", "tca_behaviours.missions.charts", "tca_central", "tca_daemon", "{int, [double:3]}",
}  # fmt: skip
"""Words of TCA and TCM, of Python and command lines, and parts of names that are given in full
nearby.
"""

TOKENS = sorted(set(re.findall(r"`([^`\n]+)`", PAGE)) - THEIRS)


@functools.cache
def commands() -> set[str]:
    config = configparser.ConfigParser()
    config.read(ROOT / "setup.cfg")
    lines = config["options.entry_points"]["tca.commands"].split("\n")
    return {line.partition("=")[0].strip() for line in lines if line.strip()}


def public_classes() -> list[type]:
    offered = (*vars(tca_module).values(), missions.Mission, *vars(charts).values())
    return [thing for thing in offered if inspect.isclass(thing)]


def has(owner: type, name: str) -> bool:
    """Whether objects of a class have an attribute. It may be in the class, annotated, or set in
    __init__.
    """
    if hasattr(owner, name) or any(
        name in getattr(kind, "__annotations__", {}) for kind in owner.__mro__
    ):
        return True
    return any(
        re.search(rf"self\.{name}\b", inspect.getsource(vars(kind)["__init__"]))
        for kind in owner.__mro__
        if "__init__" in vars(kind)
    )


@functools.cache
def keywords() -> set[str]:
    """Return all keywords of public calls."""
    options = (tca_module.TaskOptions, tca_module.MonitorOptions, tca_module.HandlerOptions)
    found = {name for one in options for name in one.__annotations__}
    for kind in public_classes():
        for function in [thing for owner in kind.__mro__ for thing in vars(owner).values()]:
            if inspect.isfunction(function):
                found |= inspect.signature(function).parameters.keys()
    return found


@pytest.mark.parametrize("token", TOKENS)
def test_each_mapped_name_exists(token: str) -> None:
    if token.startswith("tca "):
        assert token.split()[1] in commands()
    elif token.endswith("="):
        assert token[:-1] in keywords()
    elif re.fullmatch(r"\w+", token):
        assert any(hasattr(package, token) for package in PACKAGES)
    elif match := re.fullmatch(r"([A-Z]\w+)\.(\w+)", token):
        owner = next(vars(one)[match[1]] for one in PACKAGES if match[1] in vars(one))
        assert has(owner, match[2])
    else:  # Python code: some class has its attributes and keywords
        names = re.findall(r"\.([a-z]\w*)", token)
        assert names
        spans = [tca_module.this.handling, tca_module.Sender, tca_module.SentTask]
        assert all(any(hasattr(owner, name) for owner in spans) for name in names), names
        assert set(re.findall(r"(\w+)=(?!=)", token.replace("<=", ""))) <= keywords()


def test_mapping_page_links_exist() -> None:
    for link in re.findall(r"\]\(([^)#]+)\)", PAGE):
        assert (ROOT / "docs/from" / link).exists(), link


def test_mapping_page_rows_have_three_cells() -> None:
    assert all(len(cells) == 3 for cells in CELLS), [cells for cells in CELLS if len(cells) != 3]
