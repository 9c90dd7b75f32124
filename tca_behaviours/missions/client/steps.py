"""The steps of a mission: what was completed is not done again when the mission's program is
started anew.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

import msgspec

from tca_behaviours.missions.client.errors import StepUncertain, in_words
from tca_behaviours.missions.client.step_file import StepFile, StepLine, TaskBegun
from tca_behaviours.missions.client.task_handle import TaskHandle
from tca_behaviours.missions.outcomes import Status, TaskEnd
from tca_module import MisuseError, TcaError
from tca_module.checks import TEXT, check

T = TypeVar("T")
_UNKNOWN = "is unknown to central"


class Steps:
    """What is known of the steps of a mission: from its file, and from now on."""

    def __init__(
        self,
        path: Path,
        mission: str,
        find: Callable[[TaskBegun], TaskHandle | None],
        finish: Callable[[TaskHandle], object],
    ) -> None:
        """*find*: the task of an earlier run of the program; None if central has forgotten it.
        *finish*: waits for its end.
        """
        self._file = StepFile(path, mission)
        self._find, self._finish = find, finish
        self._last: dict[str, StepLine] = {}  # what became of each step
        self._tasks: dict[str, list[TaskBegun]] = {}
        for line in self._file.lines:
            self._learn(line)
        self._began_here = set[str]()
        self._now: list[str] = []  # the steps under way, the innermost last

    def close(self, *, is_finished: bool) -> None:
        """The mission has ended; a finished one begins anew the next time."""
        self._file.close(is_finished=is_finished)

    def note_task(self, task: TaskHandle) -> None:
        """A task has been started, perhaps in a step."""
        if self._now:
            begun = TaskBegun(task.name, int(task.id), getattr(task.id, "epoch", ""))
            self._note(StepLine(self._now[-1], "task", begun))

    def skip(self, name: str) -> None:
        """Take a step as done, without a value."""
        check("a step", TEXT, name=name)
        self._note(StepLine(name, "done"))

    def run(
        self, name: str, function: Callable[..., T], call: Callable[[], T], *, again: bool
    ) -> T:
        """Do a step by a *call* of the function, unless it was done before: then give its value."""
        check("a step", TEXT, name=name)
        last = self._last.get(name)
        if name in self._began_here and last is not None and last.is_ != "left":
            advice = f"give each step its own name, such as f'{name} {{number}}'"
            raise MisuseError(
                f"step '{name}' was {last.is_} by this run of the program already: {advice}"
            )
        if last is not None and last.is_ == "done":
            return _value(last, function)
        if last is not None and last.is_ == "begun":
            end = self._look_into(name, is_task=hasattr(function, "task_of_mission"), again=again)
            if end is not None:
                self._note(line := StepLine(name, "done", end=end))
                return _value(line, function)
        return self._do(name, function, call)

    def _look_into(self, name: str, *, is_task: bool, again: bool) -> TaskEnd | None:
        """What became of a step that was under way when the program died: the end of the one task
        that it was; None if it is to be done *again*. Raises StepUncertain.
        """
        tasks = self._tasks.get(name, [])
        found = [self._find(task) for task in tasks]
        for task in found:
            if task is not None and (is_task or task.is_being_stopped):
                self._finish(task)
        if is_task and len(found) == 1 and found[0] is not None:
            end = found[0].end
            if end is not None and Status.of(end.status) is Status.COMPLETED:
                return end
        if again:
            return None
        raise StepUncertain(
            name, [(str(task), _fate(handle)) for task, handle in zip(tasks, found, strict=True)]
        )

    def _do(self, name: str, function: Callable[..., T], call: Callable[[], T]) -> T:
        self._began_here.add(name)
        self._note(StepLine(name, "begun"))
        self._now.append(name)
        try:
            line = _done(name, call(), function)
        except BaseException:
            self._note(StepLine(name, "left"))
            raise
        finally:
            self._now.pop()
        self._note(line)
        return _value(line, function)

    def _note(self, line: StepLine) -> None:
        self._file.add(line)
        self._learn(line)

    def _learn(self, line: StepLine) -> None:
        if line.task is not None:
            self._tasks.setdefault(line.step, []).append(line.task)
            return
        self._last[line.step] = line
        if line.is_ == "begun":
            self._tasks[line.step] = []


def _fate(task: TaskHandle | None) -> str:
    """What became of a task, for people."""
    try:
        if task is None:
            return _UNKNOWN
        return in_words(task.end) if task.end is not None else "is running"
    except TcaError:
        return _UNKNOWN


def _done(name: str, value: Any, function: Callable[..., Any]) -> StepLine:
    """The line of a step that is done. Raises MisuseError if its value would come back as another
    one.
    """
    if isinstance(value, TaskEnd):
        return StepLine(name, "done", end=value)
    try:
        line = StepLine(name, "done", value=msgspec.msgpack.encode(value))
        kept = _value(line, function)
        is_same = kept == value or repr(kept) == repr(
            value
        )  # NaN is equal to nothing, but has one name
        why = "" if is_same else f"{value!r:.60} would come back as {kept!r:.60}"
    except (TypeError, ValueError, OverflowError, RecursionError) as error:
        why = f"{error}"
    if why:
        what = f"step '{name}' does not count as done: its value can't be kept ({why})"
        raise MisuseError(f"{what}: return plain data, and declare its type")
    return line


def _value(line: StepLine, function: Callable[..., T]) -> T:
    """The value of a step that is done, as its function declares it: the same now and when the
    mission is resumed.
    """
    value: Any = line.end
    if line.value is not None:
        try:
            value = msgspec.msgpack.decode(
                line.value, type=get_type_hints(function).get("return", Any)
            )
        except (NameError, TypeError, msgspec.ValidationError):
            value = msgspec.msgpack.decode(line.value)
    typed: T = value
    return typed
