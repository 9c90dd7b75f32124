"""Supervise one program: start it, wait for its end, start it again."""

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

_LEAST_DELAY = 0.1
"""Seconds between two checks for room on the disk, at least."""
_LAST_OUTPUT = 1.0
"""Seconds to read the last output of an ended process if another process has its pipe open."""


class GaveUp(Exception):
    """A program has crashed too often."""

    def __init__(self, why: str, name: str, last: list[bytes]) -> None:
        super().__init__(why)
        self.name = name
        self.last = last  #: its last lines


class Supervised:
    """A program that is restarted. ``run`` covers its whole life."""

    def __init__(
        self, program: Launch, output: Output, report: Callable[[str], None], programs: Programs
    ) -> None:
        self.program = program
        self.stop = threading.Event()  #: it must not be started again
        self.is_halted = False  #: an operator stopped it, and may start it again
        self.code: int | None = None  #: its last exit code, if it is not started again
        self.group = 0  #: its process group; 0: it does not run
        self._output = output
        self._report = report
        self._programs = programs
        self._restarts = Restarts(program.limits)
        self._last: list[bytes] = []
        self._is_hung = False

    def run(self) -> None:
        """Run and restart it until *stop* is set, or it ends for good. Raises GaveUp."""
        while not self.stop.is_set():
            start, self._is_hung = time.monotonic(), False
            code = self._run_once()
            if self.stop.is_set():
                if code is not None:
                    self._report(f"{self.program.name} {how_it_ended(code)}")
                return
            if code == DISK_FULL and self.program.journal is not None:
                self._wait_for_room(self.program.journal)
                continue
            how = "can't be started" if code is None else how_it_ended(code)
            if self._is_hung:
                how = "hung and was killed"
            lived = f" after {time.monotonic() - start:.1f} s" if code is not None else ""
            if self.program.restart == "never" or (
                self.program.restart == "on-failure" and code == 0
            ):
                self.code = code
                self._report(f"{self.program.name} {how}{lived}")
                return
            if self.program.is_central and code == 0:  # only after a request
                self._report(f"{self.program.name} {how}{lived}, starts again: it was asked to end")
                continue
            delay = self._delay(how)
            if delay is None:
                self.code = 1 if code is None else code
                start_it = f"'tca run --start {self.program.name}' starts it"
                self._report(f"{self._too_often(how)}: it is left down; {start_it}")
                return
            limits, count = self.program.limits, self._restarts.count
            restarts = f"restart {count} of at most {limits.restarts} within {limits.within:g} s"
            self._report(
                f"{self.program.name} {how}{lived}, starts again in {delay:g} s ({restarts})"
            )
            self.stop.wait(delay)

    def _wait_for_room(self, journal: Path) -> None:
        """Wait until the journal's disk has room, since a restart would fail again."""
        self._report(f"{self.program.name} waits for room on the disk of {journal}")
        delay = self.program.limits.delay
        while not (self.stop.wait(max(delay, _LEAST_DELAY)) or has_room(journal)):
            delay = min(2 * delay, self.program.limits.longest_delay)

    def reset(self) -> None:
        """Prepare another ``run``, which begins without earlier crashes."""
        self.stop.clear()
        self.is_halted, self.code = False, None
        self._restarts = Restarts(self.program.limits)

    def kill_hung(self) -> None:
        """Kill its hung process. It is then started again."""
        self._is_hung = True
        if self.group:
            guard.send(self.group, signal.SIGKILL)

    def _delay(self, how: str) -> float | None:
        """Return the seconds before the next start; None to leave it down. Raises GaveUp."""
        delay = self._restarts.delay(time.monotonic())
        if delay is None and not self.program.is_left_down:
            raise GaveUp(self._too_often(how), self.program.name, self._last)
        return delay

    def _too_often(self, how: str) -> str:
        within, times = self.program.limits.within, self._restarts.count
        often = f", {times} times within {within:g} s" if times > 1 else ""
        return f"{self.program.name} {how}{often}"

    def _run_once(self) -> int | None:
        """Run its process to the end. Return the exit code, or None if it could not be started."""
        program = self.program
        read, write = os.pipe()
        try:
            self.group = self._programs.start(
                program.name,
                *program.command,
                ends_last=program.ends_last,
                cwd=program.cwd,
                env=program.env,
                stdout=write,
                stderr=write,
            )
        except OSError as error:
            os.close(read)
            self._last = [f"{program.command[0]}: {error.strerror}".encode()]
            self._output.show(program.name, self._last[0])
            return None
        finally:
            os.close(write)
        self._report(f"{program.name} started (process {self.group})")
        lines = self._output.listen(program.name, read)
        code = self._programs.wait(program.name)
        self.group = 0
        lines.closed.wait(_LAST_OUTPUT)
        self._last = list(lines.last)
        return code
