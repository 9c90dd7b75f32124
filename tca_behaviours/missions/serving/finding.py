"""Collects the tasks that a server offers: given ones, those of a folder, and those of installed
packages.

A task of a folder or package that can't be offered is logged and left out.
"""

import importlib.util
import logging
import sys
from collections.abc import Iterable, Iterator
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

from tca_behaviours.missions.serving.definition import (
    Definition,
    ServedTask,
    check_task,
    environment_of,
)
from tca_behaviours.missions.serving.environment import Environment
from tca_module import BadFormat, MisuseError

ENTRY_POINTS = "tca.missions.tasks"
"""The group of entry points with which installed packages name their tasks."""


class TaskFinder:
    """Collects the definitions for a server. The first task of a name wins."""

    def __init__(
        self,
        server: str,
        environment: Environment,
        rate: float,
        log: logging.Logger,
        idle: type[ServedTask[Any]] | None = None,
    ) -> None:
        self.definitions: dict[str, Definition] = {}
        self._server = server
        self._environment = environment
        self._rate = rate
        self._log = log
        self._idle = idle
        self._found_in: dict[str, str] = {}

    def add_given(self, tasks: Iterable[type[ServedTask[Any]]]) -> None:
        """Add tasks of the server's own program.

        Raises MisuseError, or BadFormat, if one can't be offered.
        """
        for task in tasks:
            self._add(task, "tasks=")

    def add_folder(self, folder: Path) -> None:
        """Add the tasks that a folder's Python files define. Files that begin with "_" are left
        out.
        """
        if not folder.is_dir():
            raise MisuseError(f"server '{self._server}': folder {folder} does not exist")
        for file in sorted(folder.glob("[!_]*.py")):
            try:
                module = _load(file)
            except (Exception, SystemExit) as error:  # noqa: BLE001 - a file may raise anything
                self._log_left_out(f"the tasks of {file} are", error)
                continue
            for task in _tasks_of(module):
                self._add_or_log(task, str(file))

    def add_installed(self) -> None:
        """Add the tasks of installed packages that are made for this environment."""
        for entry in entry_points(group=ENTRY_POINTS):
            where = f"entry point '{entry.name}' ({entry.value})"
            try:
                task = check_task(entry.load())
            except (Exception, SystemExit) as error:  # noqa: BLE001 - a package may raise anything
                self._log_left_out(f"{where} is", error)
                continue
            if isinstance(self._environment, environment_of(task)):
                self._add_or_log(task, where)

    def _log_left_out(self, subject_and_verb: str, error: BaseException) -> None:
        kind = type(error).__name__
        self._log.error("%s left out: %s: %s", subject_and_verb, kind, error, exc_info=error)

    def _add_or_log(self, task: type[ServedTask[Any]], where: str) -> None:
        try:
            self._add(task, where)
        except (MisuseError, BadFormat) as error:
            self._log.error("%s is left out: %s", where, error)

    def _add(self, task: type[ServedTask[Any]], where: str) -> None:
        name, wanted = check_task(task).__name__, environment_of(task)
        if name in self.definitions:
            if self.definitions[name].task is task:
                return
            raise MisuseError(
                f"task {name} is defined in {self._found_in[name]} already: rename one of the two"
            )
        if not isinstance(self._environment, wanted):
            given = type(self._environment).__name__
            raise MisuseError(
                f"task {name} needs an environment of class {wanted.__name__}, "
                f"not the server's {given}"
            )
        self.definitions[name] = Definition(
            task, self._server, self._rate, is_idle=task is self._idle
        )
        self._found_in[name] = where


def _load(file: Path) -> ModuleType:
    name = f"tca_mission_tasks_{abs(hash(file.resolve().parent)):x}_{file.stem}"
    spec = importlib.util.spec_from_file_location(name, file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # type hints of parameters are resolved there
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module


def _tasks_of(module: ModuleType) -> Iterator[type[ServedTask[Any]]]:
    """Yield the tasks that a file itself defines. A name that begins with "_" marks a base
    class.
    """
    for value in vars(module).values():
        is_own = isinstance(value, type) and value.__module__ == module.__name__
        if is_own and issubclass(value, ServedTask) and not value.__name__.startswith("_"):
            yield value
