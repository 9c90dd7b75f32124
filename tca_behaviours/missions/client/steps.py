"""The steps of a mission: a completed step is not repeated when the program is started again."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

import msgspec

from tca_behaviours.missions.client.errors import StepUncertain, describe_end
from tca_behaviours.missions.client.step_file import StepFile, StepLine, TaskBegun
from tca_behaviours.missions.client.task_handle import TaskHandle
from tca_behaviours.missions.outcomes import Status, TaskEnd
from tca_module import MisuseError, TcaError
from tca_module.checks import TEXT, check

T = TypeVar("T")
_UNKNOWN = "is unknown to central"


class Steps:
    """The steps of a mission: those in its file, and those of this run of the program."""

    def __init__(
        self,
        path: Path,
        mission: str,
        find_task: Callable[[TaskBegun], TaskHandle | None],
        finish: Callable[[TaskHandle], object],
    ) -> None:
        """Open the file, and read its steps.

        Args:
            path: the file that records the steps.
            mission: the mission's name.
            find_task: finds a task that an earlier run of the program has started; None if central
                has forgotten it.
            finish: waits for the end of a task.
        """
        self._file = StepFile(path, mission)
        self._find_task, self._finish = find_task, finish
        self._newest: dict[str, StepLine] = {}  # by step, the newest line that is not a "task"
        self._tasks: dict[str, list[TaskBegun]] = {}
        for line in self._file.lines:
            self._index(line)
        self._begun_in_this_run = set[str]()
        self._under_way: list[str] = []  # innermost last

    def close(self, *, is_finished: bool) -> None:
        """Close the file. If the mission *is finished*, its next run starts with the first step."""
        self._file.close(is_finished=is_finished)

    def record_task(self, task: TaskHandle) -> None:
        """Record that a task was started, if a step is under way."""
        if self._under_way:
            begun = TaskBegun(
                task.name, int(task.id), getattr(task.id, "epoch", ""), task.sent.message
            )
            self._record(StepLine(self._under_way[-1], "task", begun))

    def skip(self, name: str) -> None:
        """Mark a step as done, without a value."""
        check("a step", TEXT, name=name)
        self._record(StepLine(name, "done"))

    def run(
        self, name: str, function: Callable[..., T], call: Callable[[], T], *, is_repeatable: bool
    ) -> T:
        """Do a step by a *call* of its function. Return the recorded value if the step was done
        before.

        A *repeatable* step that was interrupted by the end of the program is repeated.
        """
        check("a step", TEXT, name=name)
        last = self._newest.get(name)
        if name in self._begun_in_this_run and last is not None and last.is_ != "left":
            raise MisuseError(
                f"step '{name}' was {last.is_} by this run of the program already: "
                f"give each step its own name, such as f'{name} {{number}}'"
            )
        if last is not None and last.is_ == "done":
            return _value(last, function)
        if last is not None and last.is_ == "begun":
            is_task = hasattr(function, "task_of_mission")
            end = self._end_of_interrupted(name, is_task=is_task, is_repeatable=is_repeatable)
            if end is not None:
                self._record(line := StepLine(name, "done", end=end))
                return _value(line, function)
        return self._do(name, function, call)

    def _end_of_interrupted(
        self, name: str, *, is_task: bool, is_repeatable: bool
    ) -> TaskEnd | None:
        """Find the end of a step that was under way when the program died.

        If the step *is a task*, waits for its tasks. Otherwise waits only for tasks that are being
        stopped. Returns the end of the task if the step was one task that completed. Returns None
        if the step must be repeated. In all other cases raises StepUncertain.
        """
        tasks = self._tasks.get(name, [])
        found = [self._find_task(task) for task in tasks]
        for task in found:
            if task is not None and (is_task or task.is_being_stopped):
                self._finish(task)
        if is_task and len(found) == 1 and found[0] is not None:
            end = found[0].end
            if end is not None and Status.of(end.status) is Status.COMPLETED:
                return end
        if is_repeatable:
            return None
        states = map(_state_in_words, found)
        raise StepUncertain(name, list(zip(map(str, tasks), states, strict=True)))

    def _do(self, name: str, function: Callable[..., T], call: Callable[[], T]) -> T:
        self._begun_in_this_run.add(name)
        self._record(StepLine(name, "begun"))
        self._under_way.append(name)
        try:
            line = _line_of_done(name, call(), function)
        except BaseException:
            self._record(StepLine(name, "left"))
            raise
        finally:
            self._under_way.pop()
        self._record(line)
        return _value(line, function)

    def _record(self, line: StepLine) -> None:
        self._file.add(line)
        self._index(line)

    def _index(self, line: StepLine) -> None:
        if line.task is not None:
            self._tasks.setdefault(line.step, []).append(line.task)
            return
        self._newest[line.step] = line
        if line.is_ == "begun":
            self._tasks[line.step] = []


def _state_in_words(task: TaskHandle | None) -> str:
    """Describe the state of a task, for StepUncertain."""
    try:
        if task is not None:
            return describe_end(task.end) if task.end is not None else "is running"
    except TcaError:
        pass
    return _UNKNOWN


def _line_of_done(name: str, value: Any, function: Callable[..., Any]) -> StepLine:
    """Return the line of a step that is done.

    Raises MisuseError if the file can't return the same value.
    """
    if isinstance(value, TaskEnd):
        return StepLine(name, "done", end=value)
    try:
        line = StepLine(name, "done", value=msgspec.msgpack.encode(value))
        restored = _value(line, function)
        # NaN does not equal itself, so compare its repr.
        is_same = restored == value or repr(restored) == repr(value)
        why = "" if is_same else f"{value!r:.60} would be read as {restored!r:.60}"
    except (TypeError, ValueError, OverflowError, RecursionError) as error:
        why = f"{error}"
    if why:
        raise MisuseError(
            f"step '{name}' does not count as done: its value can't be stored ({why}): "
            "return plain data, and declare its type"
        )
    return line


def _value(line: StepLine, function: Callable[..., T]) -> T:
    """Return the value of a step that is done, with the type that its function declares.

    The value is decoded from the line even if the step was done just now, so that a resumed mission
    gets the same value.
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
