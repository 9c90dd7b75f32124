"""The file in which a mission notes its steps: a line of JSON each, on the disk before the mission
goes on.
"""

import contextlib
import fcntl
import os
from pathlib import Path
from typing import Literal

import msgspec

from tca_behaviours.missions.outcomes import TaskEnd
from tca_module import MisuseError

_VERSION = 2


class TaskBegun(msgspec.Struct, frozen=True):
    """A task that a step has started: its name, and its number in the central of *epoch*."""

    name: str
    id: int
    epoch: str

    def __str__(self) -> str:
        return f"{self.name} {{{self.id}}}"


class StepLine(msgspec.Struct, frozen=True, omit_defaults=True):
    """A line: a step has begun, has started a task, is done with a value, or was left by an
    exception.

    The value is msgpack, since JSON has no NaN, no bytes and no keys but texts. The end of a task
    stays legible.
    """

    step: str
    is_: Literal["begun", "task", "done", "left"] = msgspec.field(name="is")
    task: TaskBegun | None = None
    end: TaskEnd | None = None
    value: bytes | None = None

    def __post_init__(self) -> None:
        if (self.is_ == "task") != (self.task is not None):
            msg = "a line of a task names it"
            raise ValueError(msg)


class _Head(msgspec.Struct, frozen=True):
    steps_of: str
    version: int


class StepFile:
    """The lines of an open file. One process at a time has it."""

    def __init__(self, path: Path, mission: str) -> None:
        """Open or make it. Raises MisuseError if it is none, is damaged, or belongs to another
        mission or process.
        """
        self._path = path
        self.lines: list[StepLine] = []  #: those that were there already
        try:
            self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
        except OSError as error:
            why = f"{error.strerror}: give the path of a file, in a folder that there is"
            raise MisuseError(f"checkpoint {path} can't be opened: {why}") from None
        try:
            self._lock()
            self._read(mission)
        except BaseException:
            os.close(self._file)
            raise

    def add(self, line: StepLine) -> None:
        """Append a line; it is on the disk when this returns."""
        self._write(line)
        self.lines.append(line)

    def close(self, *, is_finished: bool) -> None:
        """Let go of it; that of a mission that *is finished* is removed: the next one begins
        anew.
        """
        if is_finished:
            with contextlib.suppress(FileNotFoundError):
                self._path.unlink()
        os.close(self._file)

    def _lock(self) -> None:
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise MisuseError(
                f"{self._path} is in use by another mission that runs: give each its own file"
            ) from None

    def _read(self, mission: str) -> None:
        text = self._path.read_bytes()
        *whole, torn = text.split(b"\n")
        if not whole:
            os.ftruncate(self._file, 0)
            self._write(_Head(mission, _VERSION))
            self._sync_folder()
            return
        self._check_head(whole[0], mission)
        for number, line in enumerate(whole[1:], 2):
            try:
                self.lines.append(msgspec.json.decode(line, type=StepLine))
            except msgspec.DecodeError as error:
                if number < len(whole):
                    what = f"line {number} of {self._path} is damaged ({error})"
                    raise MisuseError(
                        f"{what}: mend it, or remove the file and begin anew"
                    ) from None
                torn = line + b"\n"
        os.ftruncate(
            self._file, len(text) - len(torn)
        )  # the process died while it wrote the last line

    def _check_head(self, line: bytes, mission: str) -> None:
        try:
            head = msgspec.json.decode(line, type=_Head)
        except msgspec.DecodeError:
            raise MisuseError(
                f"{self._path} holds no steps of a mission: give another file"
            ) from None
        if head.steps_of != mission or head.version != _VERSION:
            whose = f"'{head.steps_of}'" + (
                f", in format {head.version}" if head.version != _VERSION else ""
            )
            raise MisuseError(
                f"{self._path} holds the steps of mission {whose}, not of '{mission}': give another file"
            )

    def _write(self, line: StepLine | _Head) -> None:
        data = msgspec.json.encode(line) + b"\n"
        while data:
            data = data[os.write(self._file, data) :]
        os.fsync(self._file)

    def _sync_folder(self) -> None:
        folder = os.open(self._path.absolute().parent, os.O_RDONLY | os.O_CLOEXEC)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
