"""One program, kept running: started, watched, started again, ended."""

import asyncio
import contextlib
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tca_tools.supervise import guard
from tca_tools.supervise.output import Lines, Output
from tca_tools.supervise.restarts import Restarts, how_it_ended
from tca_tools.supervise.robot_file import Launch
from tca_tools.supervise.room import has_room
from tca_wire.vocabulary import DISK_FULL

_LEAST_DELAY = 0.1  # seconds between two looks for room
_LAST_WORDS = 1.0  # seconds to read what an ended process has said, should another one hold its pipe


class GaveUp(Exception):
    """A program has ended too often."""

    def __init__(self, why: str, name: str, last: list[bytes]) -> None:
        super().__init__(why)
        self.name = name
        self.last = last  #: its last lines


class Supervised:
    """A program and its process. ``keep`` is all of its life."""

    def __init__(self, program: Launch, output: Output, tell: Callable[[str], None], guarded: int) -> None:
        self.program = program
        self.code: int | None = None  #: how it ended, if it is not to start again
        self.group = 0  #: its process, which leads a group of its own; 0: it does not run
        self._output = output
        self._tell = tell  #: what people are told
        self._guarded = guarded  #: the pipe of the guard
        self._restarts = Restarts(program.limits)
        self._last: list[bytes] = []
        self._is_hung = False

    async def keep(self, stop: asyncio.Event, hurry: asyncio.Event) -> None:
        """Keep it running until *stop*, or until it ends for good. Raises GaveUp."""
        while not stop.is_set():
            began, self._is_hung = time.monotonic(), False
            code = await self._live(stop, hurry)
            if stop.is_set():
                if code is not None:
                    self._tell(f"{self.program.name} {how_it_ended(code)}")
                return
            if code == DISK_FULL and self.program.journal is not None:
                await self._until_room(self.program.journal, stop)
                continue
            how = "hung and was killed" if self._is_hung else "can't be started" if code is None else how_it_ended(code)
            lived = f" after {time.monotonic() - began:.1f} s" if code is not None else ""
            if self.program.restart == "never" or (self.program.restart == "on-failure" and code == 0):
                self.code = code
                self._tell(f"{self.program.name} {how}{lived}")
                return
            delay = self._delay(how)
            limits = self.program.limits
            count = f"restart {self._restarts.count} of at most {limits.restarts} within {limits.within:g} s"
            self._tell(f"{self.program.name} {how}{lived}, starts again in {delay:g} s ({count})")
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(stop.wait(), delay)

    async def _until_room(self, journal: Path, stop: asyncio.Event) -> None:
        """Wait until the journal's disk has room: no number of starts makes some."""
        self._tell(f"{self.program.name} waits for room on the disk of {journal}")
        delay, longest = self.program.limits.delay, self.program.limits.longest_delay
        while not stop.is_set():
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(stop.wait(), max(delay, _LEAST_DELAY))
            if await asyncio.to_thread(has_room, journal):
                return
            delay = min(2 * delay, longest)

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

    async def _live(self, stop: asyncio.Event, hurry: asyncio.Event) -> int | None:
        """One life of its process; the return code, or None if it could not be started."""
        loop, program = asyncio.get_running_loop(), self.program
        read, write = os.pipe()
        transport, lines = await loop.connect_read_pipe(
            lambda: Lines(lambda line: self._output.put(program.name, line)), os.fdopen(read, "rb", 0)
        )
        transport.pause_reading()  # so that what it says comes after the line that it has started
        try:
            process = await self._start(write)
        except OSError as error:
            self._last = [f"{program.command[0]}: {error.strerror}".encode()]
            self._output.put(program.name, self._last[0])
            transport.close()
            return None
        finally:
            os.close(write)
        self.group = process.pid
        self._tell(f"{program.name} started (process {process.pid})")
        transport.resume_reading()
        await self._watch(process, stop, hurry)
        guard.send(self.group, signal.SIGKILL)  # what it has left behind
        os.write(self._guarded, guard.gone(self.group))
        self.group = 0
        await asyncio.wait([lines.over], timeout=_LAST_WORDS)
        transport.close()
        self._last = list(lines.last)
        return process.returncode

    async def _start(self, output: int) -> asyncio.subprocess.Process:
        guarded, is_central = self._guarded, self.program.is_central

        def tell_guard() -> None:
            """In the new process: from its first moment on somebody ends it, and can."""
            signal.signal(signal.SIGINT, signal.SIG_DFL)  # shells have what they start in the background ignore it
            os.write(guarded, guard.started(os.getpid(), is_central=is_central))

        return await asyncio.create_subprocess_exec(
            *self.program.command, cwd=self.program.cwd, env=self.program.env, stdin=asyncio.subprocess.DEVNULL,
            stdout=output, stderr=output, start_new_session=True, preexec_fn=tell_guard,
        )  # fmt: skip

    async def _watch(self, process: asyncio.subprocess.Process, stop: asyncio.Event, hurry: asyncio.Event) -> None:
        """Wait for its end, and bring that about after *stop*."""
        end = asyncio.ensure_future(process.wait())
        await _first(end, stop, None)
        if end.done():
            return
        for number, patience in ((signal.SIGINT, self.program.limits.grace), (signal.SIGTERM, guard.LAST_GRACE)):
            guard.ask_to_end(process.pid, number)
            deadline = time.monotonic() + patience
            await _first(end, hurry, patience)
            while guard.is_alive(process.pid) and not hurry.is_set() and time.monotonic() < deadline:
                with contextlib.suppress(TimeoutError):  # a shell ends before the program that it has started
                    await asyncio.wait_for(hurry.wait(), guard.LOOK)
            if end.done() and not guard.is_alive(process.pid):
                return
        self._tell(f"{self.program.name} did not end in time and is killed")
        guard.send(process.pid, signal.SIGKILL)
        await end


async def _first(end: "asyncio.Future[int]", event: asyncio.Event, patience: float | None) -> None:
    """Wait for one of them."""
    told = asyncio.ensure_future(event.wait())
    waiting: list[asyncio.Future[Any]] = [end, told]
    await asyncio.wait(waiting, timeout=patience, return_when=asyncio.FIRST_COMPLETED)
    told.cancel()
