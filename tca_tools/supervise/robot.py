"""All programs of a robot together: begun, told about, ended in order."""

import asyncio
import os
import signal
import sys
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from tca_tools.supervise import guard
from tca_tools.supervise.hung import Silences
from tca_tools.supervise.output import Output
from tca_tools.supervise.robot_file import RUN, RobotFile
from tca_tools.supervise.supervised import Supervised
from tca_wire.text.printable import printable

_GUARD_AGAIN = 1.0
_SAME = 0.5
"""Seconds in which a second signal is the same one: "timeout" sends it to the program and to its group."""


class Running:
    """A robot that runs."""

    def __init__(self, robot: RobotFile, output: Output) -> None:
        self._output = output
        self._stop, self._hurry = asyncio.Event(), asyncio.Event()
        self._stop_central, self._hurry_central = asyncio.Event(), asyncio.Event()
        self._asked = 0.0
        read, self._guarded = os.pipe()
        self._guard_input = read
        self._kept = [Supervised(program, output, self._tell, self._guarded) for program in robot.programs]
        hung = [kept for kept in self._kept if kept.program.restarts_hung]
        self._silences = Silences(robot.address, hung, self._tell) if hung else None

    async def run(self) -> bool:
        """Run it until somebody ends it, or until its modules have ended: whether they did well. Raises GaveUp."""
        self._hear_signals()
        loop = asyncio.get_running_loop()
        self._output.on_closed = lambda: loop.call_soon_threadsafe(self._end, "nobody reads the output")
        async with self._guard():
            modules = [kept for kept in self._kept if not kept.program.is_central]
            centrals = [kept for kept in self._kept if kept.program.is_central]
            serving = [asyncio.ensure_future(kept.keep(self._stop_central, self._hurry_central)) for kept in centrals]
            keeping = [asyncio.ensure_future(kept.keep(self._stop, self._hurry)) for kept in modules]
            if self._silences is not None:
                self._silences.start()
            failure = await self._until_over(keeping, serving)
            self._stop.set()
            await _settled(keeping)
            if self._silences is not None:
                await self._silences.end()
            self._stop_central.set()
            await _settled(serving)
        if failure is not None:
            raise failure
        return all(kept.code in (0, None) for kept in modules)

    async def _until_over(
        self, modules: list["asyncio.Task[None]"], central: list["asyncio.Task[None]"]
    ) -> BaseException | None:
        """Wait until it is to end; the error that ends it, if one does."""
        stopped = asyncio.ensure_future(self._stop.wait())
        while not self._stop.is_set():
            waiting = {one for one in [*modules, *central] if not one.done()}
            await asyncio.wait({stopped, *waiting}, return_when=asyncio.FIRST_COMPLETED)
            failed = [one.exception() for one in [*modules, *central] if one.done()]
            if failure := next(filter(None, failed), None):
                self._tell(f"gives up, and ends all: {failure}")
                stopped.cancel()
                return failure
            if modules and all(one.done() for one in modules) and not self._stop.is_set():
                self._end("all programs have ended")
        stopped.cancel()
        return None

    def _hear_signals(self) -> None:
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            if number != signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN:  # nohup
                loop.add_signal_handler(number, self._end, f"{number.name}, which again kills what is slow")

        # whoever prints would stand still, too, as soon as its pipe is full
        loop.add_signal_handler(signal.SIGTSTP, self._tell, "Ctrl-Z is not heard: programs go on")

    def _end(self, why: str) -> None:
        """End all; asked again, what is slow at once."""
        now = time.monotonic()
        if self._stop.is_set():
            if now - self._asked > _SAME:
                (self._hurry_central if self._stop_central.is_set() else self._hurry).set()
            return
        self._asked = now
        self._stop.set()
        self._tell(f"ends all: {why}")

    def _tell(self, text: str) -> None:
        up = sum(kept.group != 0 for kept in self._kept)
        self._output.put(RUN, f"{printable(text)} [{up} of {len(self._kept)} run]".encode(errors="replace"))

    @asynccontextmanager
    async def _guard(self) -> AsyncIterator[None]:
        """While the block lasts another process waits for the end of this one; the guard that is killed is replaced."""
        guarding = asyncio.ensure_future(self._keep_guard())
        try:
            yield
        finally:
            os.close(self._guarded)
            os.close(self._guard_input)
            await guarding

    async def _keep_guard(self) -> None:
        grace = max(kept.program.limits.grace for kept in self._kept)
        while True:
            process = await asyncio.create_subprocess_exec(
                sys.executable, "-IS", guard.__file__, f"{grace:g}", stdin=self._guard_input, start_new_session=True
            )
            code = await process.wait()
            if code == 0:
                return
            self._tell(f"its guard ended ({code}); another one starts")
            await asyncio.sleep(_GUARD_AGAIN)
            for kept in self._kept:
                if kept.group:
                    os.write(self._guarded, guard.started(kept.group, is_central=kept.program.is_central))


async def _settled(tasks: list["asyncio.Task[None]"]) -> None:
    await asyncio.gather(*tasks, return_exceptions=True)


def run_robot(robot: RobotFile, output: Output) -> bool:
    """Run a robot to its end; whether its programs did well. Raises GaveUp."""

    async def run() -> bool:
        return await Running(robot, output).run()

    return asyncio.run(run())
