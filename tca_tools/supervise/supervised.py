"""One program, kept running: started, watched, started again."""

import os
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path

from tca_tools.supervise import guard
from tca_tools.supervise.output import Output
from tca_tools.supervise.programs import Programs
from tca_tools.supervise.restarts import Restarts, how_it_ended
from tca_tools.supervise.robot_file import Launch
from tca_tools.supervise.room import has_room
from tca_wire.vocabulary import DISK_FULL

_LEAST_DELAY = 0.1  # seconds between two looks for room
_LAST_WORDS = (
    1.0  # seconds to read what an ended process has said, should another one hold its pipe
)


class GaveUp(Exception):
    """A program has ended too often."""

    def __init__(self, why: str, name: str, last: list[bytes]) -> None:
        super().__init__(why)
        self.name = name
        self.last = last  #: its last lines


class Supervised:
    """A program and its process. ``keep`` is all of its life."""

    def __init__(
        self, program: Launch, output: Output, tell: Callable[[str], None], programs: Programs
    ) -> None:
        self.program = program
        self.stop = threading.Event()  #: it is not to be started again
        self.code: int | None = None  #: how it ended, if it is not to start again
        self.group = 0  #: its process, which leads a group of its own; 0: it does not run
        self._output = output
        self._tell = tell  #: what people are told
        self._programs = programs
        self._restarts = Restarts(program.limits)
        self._last: list[bytes] = []
        self._is_hung = False

    def keep(self) -> None:
        """Keep it running until *stop*, or until it ends for good. Raises GaveUp."""
        while not self.stop.is_set():
            began, self._is_hung = time.monotonic(), False
            code = self._live()
            if self.stop.is_set():
                if code is not None:
                    self._tell(f"{self.program.name} {how_it_ended(code)}")
                return
            if code == DISK_FULL and self.program.journal is not None:
                self._wait_for_room(self.program.journal)
                continue
            how = (
                "hung and was killed"
                if self._is_hung
                else "can't be started"
                if code is None
                else how_it_ended(code)
            )
            lived = f" after {time.monotonic() - began:.1f} s" if code is not None else ""
            if self.program.restart == "never" or (
                self.program.restart == "on-failure" and code == 0
            ):
                self.code = code
                self._tell(f"{self.program.name} {how}{lived}")
                return
            delay = self._delay(how)
            limits = self.program.limits
            count = f"restart {self._restarts.count} of at most {limits.restarts} within {limits.within:g} s"
            self._tell(f"{self.program.name} {how}{lived}, starts again in {delay:g} s ({count})")
            self.stop.wait(delay)

    def _wait_for_room(self, journal: Path) -> None:
        """Wait until the journal's disk has room: no number of starts makes some."""
        self._tell(f"{self.program.name} waits for room on the disk of {journal}")
        delay = self.program.limits.delay
        while not (self.stop.wait(max(delay, _LEAST_DELAY)) or has_room(journal)):
            delay = min(2 * delay, self.program.limits.longest_delay)

    def kill_hung(self) -> None:
        """Kill its process, which stands still; it is started again."""
        self._is_hung = True
        if self.group:
            guard.send(self.group, signal.SIGKILL)

    def _delay(self, how: str) -> float:
        delay = self._restarts.delay(time.monotonic())
        if delay is None:
            within, times = self.program.limits.within, self._restarts.count
            often = f", {times} times within {within:g} s" if times > 1 else ""
            raise GaveUp(f"{self.program.name} {how}{often}", self.program.name, self._last)
        return delay

    def _live(self) -> int | None:
        """One life of its process; the return code, or None if it could not be started."""
        program = self.program
        read, write = os.pipe()
        try:
            self.group = self._programs.start(
                program.name,
                *program.command,
                ends_last=program.is_central,
                cwd=program.cwd,
                env=program.env,
                stdout=write,
                stderr=write,
            )
        except OSError as error:
            os.close(read)
            self._last = [f"{program.command[0]}: {error.strerror}".encode()]
            self._output.put(program.name, self._last[0])
            return None
        finally:
            os.close(write)
        self._tell(f"{program.name} started (process {self.group})")
        lines = self._output.listen(program.name, read)
        code = self._programs.wait(program.name)
        self.group = 0
        lines.over.wait(_LAST_WORDS)
        self._last = list(lines.last)
        return code
