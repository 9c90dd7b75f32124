"""Run all programs of a robot: start them, report on them, end them in order."""

import queue
import signal
import threading
import time
from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from shutil import rmtree
from types import FrameType

from tca_tools.errors import ToolError
from tca_tools.supervise import guard
from tca_tools.supervise.control import Control
from tca_tools.supervise.hung import HangWatch
from tca_tools.supervise.output import Output
from tca_tools.supervise.programs import Programs
from tca_tools.supervise.robot_file import RUN, RobotFile
from tca_tools.supervise.supervised import Supervised
from tca_wire.text.nearest import nearest_or_all
from tca_wire.text.printable import printable

_SAME_SIGNAL = 0.5
"""Seconds in which a repeated signal counts as one.

The command "timeout" sends its signal to the program and to the program's group.
"""


class Running:
    """A running robot. A thread supervises each program; the main thread waits for the end."""

    def __init__(self, robot: RobotFile, output: Output, file: Path) -> None:
        self._output, self._scratch = output, robot.scratch
        self._address, self._has_others = robot.address, robot.has_others
        self._control = Control(file, self._act, self._report)
        self._lock = threading.Lock()  #: held while a program is started, or the end begins
        self._is_ending = False
        self._keeps_run = False  #: whether central ends without ending the run
        self._threads = ThreadPoolExecutor(len(robot.programs))
        self._futures: dict[Supervised, Future[None]] = {}
        #: Reasons to end all, with their times. "" stands for a program that has ended.
        self._reasons: queue.SimpleQueue[tuple[float, str]] = queue.SimpleQueue()
        self._end_requested_at = 0.0
        self._has_second_request = False
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
        modules, centrals, servers = (
            [one for one in self._supervised if one.program.ends_last == stage]
            for stage in range(3)
        )
        with self._programs, self._threads:
            if "," in self._address:
                self._report(f"other programs find central with TCA_CENTRAL={self._address}")
            for one in self._supervised:
                self._start(one)
            if self._hang_watch is not None:
                self._hang_watch.start()
            with self._control:
                failure = self._wait(modules)
                with self._lock:
                    self._is_ending = True
            self._stop_programs(modules, self._is_hurried)
            if self._hang_watch is not None:
                self._hang_watch.stop()
            if self._keeps_run:
                with suppress(ToolError):
                    for one in centrals:
                        self._halt(one)
            self._stop_programs(centrals, self._is_hurried)
            self._stop_programs(servers, self._is_hurried)
        if failure is not None:
            raise failure
        if self._scratch is not None:
            rmtree(self._scratch, ignore_errors=True)
        return all(one.code in (0, None) for one in modules)

    def _start(self, one: Supervised) -> None:
        """Run a program in a thread, until it has ended for good."""
        with self._lock:
            if self._is_ending:
                raise ToolError("'tca run' is ending: start it again afterwards")
            one.reset()
            self._futures[one] = self._threads.submit(one.run)
        self._futures[one].add_done_callback(lambda _: self._request_end(""))

    def _wait(self, modules: list[Supervised]) -> BaseException | None:
        """Wait for a reason to end all. If the reason is an error, return it."""
        while True:
            requested_at, why = self._reasons.get()
            errors = [future.exception() for future in self._futures.values() if future.done()]
            if failure := next(filter(None, errors), None):
                self._report(f"gives up, and ends all: {failure}")
                return failure
            with self._lock:
                is_over = bool(modules) and all(map(self._is_over, modules))
            if is_over and not why:
                why = "all programs have ended"
            if why:
                self._end_requested_at = requested_at
                self._report(f"ends all: {why}")
                return None

    def _is_over(self, one: Supervised) -> bool:
        """Whether a program has ended for good. An operator may start a halted one again."""
        return self._futures[one].done() and not one.is_halted

    def _is_hurried(self) -> bool:
        """Read the new requests to end. Return whether there has been a second one."""
        while not self._reasons.empty():
            requested_at, why = self._reasons.get()
            if why and requested_at - self._end_requested_at > _SAME_SIGNAL:
                self._has_second_request = True
        return self._has_second_request

    def _stop_programs(
        self, programs: Iterable[Supervised], is_hurried: Callable[[], bool] = lambda: False
    ) -> None:
        """Stop programs, and wait for their threads. If *is_hurried*, kill slow programs."""
        programs = list(programs)

        def on_kill(group: int) -> None:
            for one in programs:
                if one.group == group:
                    self._report(f"{one.program.name} did not end in time and is killed")

        for one in programs:
            one.stop.set()
        while left := [one for one in programs if not self._futures[one].done()]:
            graces = {one.group: one.program.limits.grace for one in left if one.group}
            guard.stop_all(graces, is_hurried, on_kill)
            time.sleep(guard.POLL_SECONDS)

    # --- single programs --------------------------------------------------------------------------

    def _act(self, action: str, names: list[str]) -> list[str]:
        """Stop, start or restart programs for an operator. Return lines for the operator.

        Raises ToolError.
        """
        known = {one.program.name.partition(".")[0] for one in self._supervised}
        known |= {one.program.name for one in self._supervised}
        if unknown := next((name for name in names if name not in known), None):
            raise ToolError(f"--{action} {unknown}: {nearest_or_all(unknown, known)}")
        chosen = [
            one
            for one in self._supervised
            if {one.program.name, one.program.name.partition(".")[0]} & {*names}
        ]
        return [self._act_on(one, action) for one in chosen]

    def _act_on(self, one: Supervised, action: str) -> str:
        name, is_running = one.program.name, not self._futures[one].done()
        if action == "start" and is_running:
            return f"{name} runs already"
        if action != "start":
            self._halt(one)
        if action == "stop":
            return f"{name} stopped" if is_running else f"{name} was down already"
        self._start(one)
        return f"{name} {action}ed"

    def _halt(self, one: Supervised) -> None:
        """Stop a program until an operator starts it again. Central keeps its run.

        Raises ToolError if central did not end in time; then it still runs.
        """
        one.is_halted = True
        if one.program.is_central and one.group:
            one.stop.set()
            guard.ask_to_end(one.group, signal.SIGUSR1)
            try:
                self._futures[one].result(one.program.limits.grace)
            except TimeoutError:
                one.stop.clear()
                one.is_halted = False
                name = one.program.name
                raise ToolError(f"{name} did not end in time: see what it says") from None
        self._stop_programs([one])

    def _handle_signals(self) -> None:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            if number != signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN:  # nohup
                signal.signal(number, self._on_signal)

        # if this process stopped, the programs would block as soon as their pipes are full
        signal.signal(
            signal.SIGTSTP, lambda *_: self._report("Ctrl-Z is ignored: programs continue")
        )

    def _on_signal(self, number: int, _: FrameType | None) -> None:
        # A computer that is turned off sends SIGTERM: the centrals of others continue the run.
        self._keeps_run = self._has_others and number != signal.SIGINT
        self._request_end(f"{signal.Signals(number).name}; a second one kills slow programs")

    def _request_end(self, why: str) -> None:
        """Wake the main thread to end all; without a reason it only checks the programs."""
        self._reasons.put((time.monotonic(), why))

    def _report(self, text: str) -> None:
        running = sum(one.group != 0 for one in self._supervised)
        line = f"{printable(text)} [{running} of {len(self._supervised)} run]"
        self._output.show(RUN, line.encode(errors="replace"))
