"""All programs of a robot together: begun, told about, ended in order."""

import queue
import signal
import time
from concurrent.futures import Future, ThreadPoolExecutor
from types import FrameType

from tca_tools.supervise import guard
from tca_tools.supervise.hung import Silences
from tca_tools.supervise.output import Output
from tca_tools.supervise.programs import Programs
from tca_tools.supervise.robot_file import RUN, RobotFile
from tca_tools.supervise.supervised import Supervised
from tca_wire.text.printable import printable

_SAME = 0.5
"""Seconds in which a second signal is the same one: "timeout" sends it to the program and to its
group.
"""


class Running:
    """A robot that runs. Each program is kept by a thread; this one hears what ends them all."""

    def __init__(self, robot: RobotFile, output: Output) -> None:
        self._output = output
        self._reasons: queue.SimpleQueue[tuple[float, str]] = (
            queue.SimpleQueue()
        )  #: to end, with their times
        self._asked = 0.0  #: when it was asked to end
        grace = max(program.limits.grace for program in robot.programs)
        self._programs = Programs(grace=grace, starter="'tca run'", tell=self._tell)
        self._kept = [Supervised(one, output, self._tell, self._programs) for one in robot.programs]
        hung = [kept for kept in self._kept if kept.program.restarts_hung]
        self._silences = Silences(robot.address, hung, self._tell) if hung else None

    def run(self) -> bool:
        """Run it until it is ended, or until its modules have ended: whether they did well. Raises
        GaveUp.
        """
        self._hear_signals()
        self._output.on_closed = lambda: self._end("nobody reads the output")
        with self._programs, ThreadPoolExecutor(len(self._kept)) as threads:
            keeping = {kept: threads.submit(kept.keep) for kept in self._kept}
            for future in keeping.values():
                future.add_done_callback(lambda _: self._end(""))
            modules = {
                kept: future for kept, future in keeping.items() if not kept.program.is_central
            }
            if self._silences is not None:
                self._silences.start()
            failure = self._wait(modules, list(keeping.values()))
            self._end_programs(modules)
            if self._silences is not None:
                self._silences.end()
            self._end_programs(keeping)
        if failure is not None:
            raise failure
        return all(kept.code in (0, None) for kept in modules)

    def _wait(
        self, modules: dict[Supervised, "Future[None]"], keeping: list["Future[None]"]
    ) -> BaseException | None:
        """Wait until it is to end; the error that ends it, if one does."""
        while True:
            asked, why = self._reasons.get()
            failed = [future.exception() for future in keeping if future.done()]
            if failure := next(filter(None, failed), None):
                self._tell(f"gives up, and ends all: {failure}")
                return failure
            if not why and modules and all(future.done() for future in modules.values()):
                why = "all programs have ended"
            if why:
                self._asked = asked
                self._tell(f"ends all: {why}")
                return None

    def _end_programs(self, keeping: dict[Supervised, "Future[None]"]) -> None:
        """End programs, and wait until their threads have done with them. Asked once more, what is
        slow at once.
        """
        hurries = False

        def is_hurried() -> bool:
            nonlocal hurries
            while not self._reasons.empty():
                asked, why = self._reasons.get()
                hurries = hurries or bool(why and asked - self._asked > _SAME)
            return hurries

        def on_kill(group: int) -> None:
            for kept in keeping:
                if kept.group == group:
                    self._tell(f"{kept.program.name} did not end in time and is killed")

        for kept in keeping:
            kept.stop.set()
        while left := [kept for kept, future in keeping.items() if not future.done()]:
            graces = {kept.group: kept.program.limits.grace for kept in left if kept.group}
            guard.end_all(graces, is_hurried, on_kill)
            time.sleep(guard.LOOK)

    def _hear_signals(self) -> None:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            if number != signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN:  # nohup
                signal.signal(number, self._on_signal)

        # whoever prints would stand still, too, as soon as its pipe is full
        signal.signal(signal.SIGTSTP, lambda *_: self._tell("Ctrl-Z is not heard: programs go on"))

    def _on_signal(self, number: int, _: FrameType | None) -> None:
        self._end(f"{signal.Signals(number).name}, which again kills what is slow")

    def _end(self, why: str) -> None:
        """Wake the thread that ends all; without a reason it only looks around."""
        self._reasons.put((time.monotonic(), why))

    def _tell(self, text: str) -> None:
        up = sum(kept.group != 0 for kept in self._kept)
        self._output.put(
            RUN, f"{printable(text)} [{up} of {len(self._kept)} run]".encode(errors="replace")
        )
