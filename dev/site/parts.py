"""Writes the generated parts of the reference to build/parts, before the site is built."""

from collections.abc import Callable

from dev.site import command_parts, drawings, python_parts, record_parts, robot_parts
from dev.site.root import PARTS

PARTS_BY_NAME: dict[str, Callable[[], str]] = {
    "command-line": command_parts.command_line,
    "conditions": python_parts.conditions,
    "coroutines": python_parts.coroutines,
    "errors": python_parts.errors,
    "export-tables": record_parts.export_tables,
    "facts": record_parts.facts,
    "failures": python_parts.failures,
    "predicates": python_parts.states,
    "robot-toml": robot_parts.robot_toml,
}


def write_parts() -> None:
    """Write all parts, and the drawings."""
    drawings.write(PARTS / "drawings")
    for name, part in PARTS_BY_NAME.items():
        (PARTS / f"{name}.md").write_text(part())
