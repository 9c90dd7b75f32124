"""The file in which a mission records its steps.

Each record is one line of JSON. It is on the disk before the mission continues.
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


class TaskBegun(msgspec.Struct, frozen=True, omit_defaults=True):
    """A task that a step has started: its name, and its number in the central of *epoch*."""

    name: str
    id: int
    epoch: str
    message: str = ""
    """The name of its command; "" in older files: that of the mission's server."""

    def __str__(self) -> str:
        return f"{self.name} {{{self.id}}}"


class StepLine(msgspec.Struct, frozen=True, omit_defaults=True):
    """A line of the file: a step began, started a task, is done with a value, or was left by an
    exception.

    The value is msgpack, because JSON has no NaN, no bytes, and only text as keys. The end of a
    task is JSON, so that people can read it.
    """

    step: str
    is_: Literal["begun", "task", "done", "left"] = msgspec.field(name="is")
    task: TaskBegun | None = None
    end: TaskEnd | None = None
    value: bytes | None = None

    def __post_init__(self) -> None:
        if (self.is_ == "task") != (self.task is not None):
            msg = "a line has a task if, and only if, its kind is 'task'"
            raise ValueError(msg)


class _Header(msgspec.Struct, frozen=True):
    steps_of: str
    version: int


class StepFile:
    """The open file of a mission's steps. Only one process at a time can open it."""

    def __init__(self, path: Path, mission: str) -> None:
        """Open or create the file, and read its lines.

        Raises MisuseError if the file holds no steps, is damaged, or belongs to another mission or
        process.
        """
        self._path = path
        self.lines: list[StepLine] = []
        try:
            self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
        except OSError as error:
            why = f"{error.strerror}: give the path of a file in an existing folder"
            raise MisuseError(f"checkpoint {path} can't be opened: {why}") from None
        try:
            self._lock()
            self._read(mission)
        except BaseException:
            os.close(self._file)
            raise

    def add(self, line: StepLine) -> None:
        """Append a line. The line is on the disk when this call returns."""
        self._write(line)
        self.lines.append(line)

    def close(self, *, is_finished: bool) -> None:
        """Close the file. Remove it if the mission *is finished*, so that the next run starts
        again.
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
                f"{self._path} is in use by another running mission: give each its own file"
            ) from None

    def _read(self, mission: str) -> None:
        text = self._path.read_bytes()
        *whole, partial = text.split(b"\n")
        if not whole:
            os.ftruncate(self._file, 0)
            self._write(_Header(mission, _VERSION))
            self._sync_folder()
            return
        self._check_header(whole[0], mission)
        for number, line in enumerate(whole[1:], 2):
            try:
                self.lines.append(msgspec.json.decode(line, type=StepLine))
            except msgspec.DecodeError as error:
                if number < len(whole):
                    problem = f"line {number} of {self._path} is damaged ({error})"
                    raise MisuseError(
                        f"{problem}: repair it, or remove the file and start again"
                    ) from None
                partial = line + b"\n"
        # A process that dies while it writes leaves a partial last line: drop it.
        os.ftruncate(self._file, len(text) - len(partial))

    def _check_header(self, line: bytes, mission: str) -> None:
        try:
            header = msgspec.json.decode(line, type=_Header)
        except msgspec.DecodeError:
            raise MisuseError(
                f"{self._path} holds no steps of a mission: give another file"
            ) from None
        if header.version != _VERSION:
            problem = f"is in format {header.version}, not {_VERSION}"
        elif header.steps_of != mission:
            problem = f"holds the steps of mission '{header.steps_of}', not of '{mission}'"
        else:
            return
        raise MisuseError(f"{self._path} {problem}: give another file")

    def _write(self, line: StepLine | _Header) -> None:
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
