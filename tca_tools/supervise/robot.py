"""Run all programs of a robot: start them, report on them, end them in order."""

import queue
import signal
import time
from concurrent.futures import Future, ThreadPoolExecutor
from types import FrameType

from tca_tools.supervise import guard
from tca_tools.supervise.hung import HangWatch
from tca_tools.supervise.output import Output
from tca_tools.supervise.programs import Programs
from tca_tools.supervise.robot_file import RUN, RobotFile
from tca_tools.supervise.supervised import Supervised
from tca_wire.text.printable import printable

_SAME_SIGNAL = 0.5
"""Seconds in which a repeated signal counts as one.

The command "timeout" sends its signal to the program and to the program's group.
"""


class Running:
    """A running robot. A thread supervises each program; the main thread waits for the end."""

    def __init__(self, robot: RobotFile, output: Output) -> None:
        self._output = output
        #: Reasons to end all, with their times. "" stands for a program that has ended.
        self._reasons: queue.SimpleQueue[tuple[float, str]] = queue.SimpleQueue()
        self._end_requested_at = 0.0
        grace = max(program.limits.grace for program in robot.programs)
        self._programs = Programs(grace=grace, starter="'tca run'", report=self._report)
        self._supervised = [
            Supervised(program, output, self._report, self._programs) for program in robot.programs
        ]
        watched = [one for one in self._supervised if one.program.restarts_hung]
        self._hang_watch = HangWatch(robot.address, watched, self._report) if watched else None

    def run(self) -> bool:
        """Run the robot until it is stopped, or all its modules have ended.

        Returns whether all modules ended with exit code 0 or were stopped. Raises GaveUp.
        """
        self._handle_signals()
        self._output.on_closed = lambda: self._request_end("the reader of the output has ended")
        with self._programs, ThreadPoolExecutor(len(self._supervised)) as threads:
            futures = {one: threads.submit(one.run) for one in self._supervised}
            for future in futures.values():
                future.add_done_callback(lambda _: self._request_end(""))
            modules = {one: future for one, future in futures.items() if not one.program.is_central}
            if self._hang_watch is not None:
                self._hang_watch.start()
            failure = self._wait(modules, list(futures.values()))
            self._stop_programs(modules)
            if self._hang_watch is not None:
                self._hang_watch.stop()
            self._stop_programs(futures)
        if failure is not None:
            raise failure
        return all(one.code in (0, None) for one in modules)

    def _wait(
        self, modules: dict[Supervised, "Future[None]"], futures: list["Future[None]"]
    ) -> BaseException | None:
        """Wait for a reason to end all. If the reason is an error, return it."""
        while True:
            requested_at, why = self._reasons.get()
            errors = [future.exception() for future in futures if future.done()]
            if failure := next(filter(None, errors), None):
                self._report(f"gives up, and ends all: {failure}")
                return failure
            if not why and modules and all(future.done() for future in modules.values()):
                why = "all programs have ended"
            if why:
                self._end_requested_at = requested_at
                self._report(f"ends all: {why}")
                return None

    def _stop_programs(self, futures: dict[Supervised, "Future[None]"]) -> None:
        """Stop programs, and wait for their threads. A second request kills slow programs."""
        is_hurried = False

        def poll_requests() -> bool:
            """Read the new requests to end. Return whether there has been a second one."""
            nonlocal is_hurried
            while not self._reasons.empty():
                requested_at, why = self._reasons.get()
                is_new = requested_at - self._end_requested_at > _SAME_SIGNAL
                is_hurried = is_hurried or bool(why and is_new)
            return is_hurried

        def on_kill(group: int) -> None:
            for one in futures:
                if one.group == group:
                    self._report(f"{one.program.name} did not end in time and is killed")

        for one in futures:
            one.stop.set()
        while left := [one for one, future in futures.items() if not future.done()]:
            graces = {one.group: one.program.limits.grace for one in left if one.group}
            guard.stop_all(graces, poll_requests, on_kill)
            time.sleep(guard.POLL_SECONDS)

    def _handle_signals(self) -> None:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            if number != signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN:  # nohup
                signal.signal(number, self._on_signal)

        # if this process stopped, the programs would block as soon as their pipes are full
        signal.signal(
            signal.SIGTSTP, lambda *_: self._report("Ctrl-Z is ignored: programs continue")
        )

    def _on_signal(self, number: int, _: FrameType | None) -> None:
        self._request_end(f"{signal.Signals(number).name}; a second one kills slow programs")

    def _request_end(self, why: str) -> None:
        """Wake the main thread to end all; without a reason it only checks the programs."""
        self._reasons.put((time.monotonic(), why))

    def _report(self, text: str) -> None:
        running = sum(one.group != 0 for one in self._supervised)
        line = f"{printable(text)} [{running} of {len(self._supervised)} run]"
        self._output.show(RUN, line.encode(errors="replace"))
