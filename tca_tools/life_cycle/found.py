"""Find life cycles: a built-in one, those of a Python file, or that of a message of a run."""

from pathlib import Path

import click

from tca_tools.errors import NotInLog
from tca_tools.journal.journals import open_log
from tca_tools.user_file import names_of
from tca_wire.journal.facts import FormatDefined
from tca_wire.life_cycles import BASIC, GENERAL, ONE_UPDATE, ROS_GOAL, LifeCycle, read_life_cycle
from tca_wire.messages.declarations import TaskMessage
from tca_wire.text.nearest import did_you_mean
from tca_wire.text.printable import printable

BUILT_IN = {one.name: one for one in (GENERAL, BASIC, ONE_UPDATE, ROS_GOAL)}


def find_life_cycles(what: str, log_path: Path | None) -> list[LifeCycle]:
    """Return the life cycles that *what* names, each once.

    Args:
        what: "general" or another built-in one, a Python file, or the name of a goal or command.
        log_path: The journal with the message; None for the newest one.

    Raises:
        UsageError: The file does not exist or has no life cycle.
        NotInLog: The journal has no such goal or command.
    """
    if what in BUILT_IN and log_path is None:
        return [BUILT_IN[what]]
    if Path(what).suffix == ".py" and log_path is None:
        return _in_file(Path(what))
    return [_of_message(what, log_path)]


def _in_file(path: Path) -> list[LifeCycle]:
    if not path.is_file():
        raise click.UsageError(f"{printable(str(path))}: no such file")
    values = list(names_of(path).values())
    found = [value for value in values if isinstance(value, LifeCycle)]
    found += [value.life_cycle for value in values if isinstance(value, TaskMessage)]
    if not found:
        raise click.UsageError(
            f"{path} has no life cycle: declare a LifeCycle, goal or command in a global variable"
        )
    each = list(dict.fromkeys(found))
    return [one for one in each if one not in BUILT_IN.values()] or each


def _of_message(name: str, log_path: Path | None) -> LifeCycle:
    journal = open_log(log_path)
    facts = (fact for entry in journal for fact in entry.facts)
    found = {one.message: one for one in facts if isinstance(one, FormatDefined)}
    journal.check()
    fact = found.get(name)
    if fact is None:
        hint = did_you_mean(name, [*found, *BUILT_IN], ": ")
        raise NotInLog(f"no message '{name}' in the journal {journal.name}{hint}")
    if not fact.message_class.is_task:
        raise NotInLog(f"{fact.message_class} '{name}' is not a task: only tasks have a life cycle")
    return read_life_cycle(fact.life_cycle)
