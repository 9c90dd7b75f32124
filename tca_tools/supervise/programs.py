"""A group of programs that end with their starter: for robots, shows, benchmarks and tests.

The caller starts, stops and kills the programs. ``tca run`` also restarts them.
"""

import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self

from tca_module import Message, Sender, SentTask, TcaError, Timeout
from tca_tools.supervise import guard
from tca_wire.endpoint import IS_STARTED_VARIABLE, VARIABLE

GRACE = 10.0
"""Seconds that a program has to end after SIGINT."""

START_TIME = 60.0
"""Seconds within which all programs must be ready."""

_GUARD_DELAY = 1.0
"""Seconds until a guard that was killed is replaced."""
_CHECK_SECONDS = 1.0
"""Seconds between two checks for programs that have ended."""


class ProgramEnded(TcaError):
    """A program ended although it was not stopped."""


class Programs:
    """Programs by name, each the leader of a process group.

    The end of the ``with`` block ends them, first those without *ends_last*. If this process is
    killed, a guard ends them. Programs of different names may be used from different threads.
    """

    def __init__(
        self,
        folder: Path | None = None,
        *,
        address: str = "",
        grace: float = GRACE,
        starter: str = "their starter",
        report: Callable[[str], object] = lambda _: None,
    ) -> None:
        """Create an empty group.

        Args:
            folder: the folder of the logs; None: the programs' output is dropped.
            address: the address of central, for all programs.
            grace: the seconds that a program has to end after SIGINT.
            starter: the guard's name for this process.
            report: is called with a line of text when the guard was killed.
        """
        self._folder = folder
        self._environment = {**os.environ}
        if address:
            self._environment |= {VARIABLE: address, IS_STARTED_VARIABLE: "1"}
        self._grace = grace
        self._guard_command = [sys.executable, "-IS", guard.__file__, f"{grace:g}", starter]
        self._report = report
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        self._starts: dict[str, tuple[tuple[str, ...], dict[str, Any]]] = {}
        self._stopping = threading.RLock()  # so that a check never sees a program half stopped

    def __enter__(self) -> Self:
        self._guard_input, self._guard_pipe = os.pipe()
        self._guard_thread = threading.Thread(target=self._run_guard, daemon=True)
        self._guard_thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        try:
            for stage in range(3):
                self.stop(*(name for name in self._running if self._ends_last(name) == stage))
        finally:
            for name in list(self._running):  # after Ctrl-C: do not wait
                self.kill(name)
            os.close(self._guard_pipe)
            os.close(self._guard_input)
            self._guard_thread.join()

    def _run_guard(self) -> None:
        """Run the guard. Replace it if it is killed, and send it all groups again."""
        while code := subprocess.Popen(
            self._guard_command, stdin=self._guard_input, start_new_session=True
        ).wait():
            self._report(f"its guard ended ({code}); another one starts")
            time.sleep(_GUARD_DELAY)
            for name, process in list(self._running.items()):
                line = guard.start_line(process.pid, ends_last=self._ends_last(name))
                os.write(self._guard_pipe, line)

    def _ends_last(self, name: str) -> int:
        return int(self._starts[name][1]["ends_last"])

    # --- start and stop ---------------------------------------------------------------------------

    def start(self, name: str, *command: str, ends_last: int = False, **options: Any) -> int:
        """Start a program under this name.

        Args:
            name: the name; one program of a name runs at a time.
            command: the program and its arguments.
            ends_last: whether it is stopped only after the others, as central is; 2: after central.
            options: options of ``subprocess.Popen``.

        Returns:
            The number of its process.

        Raises:
            OSError: it can't be started.
        """

        def register() -> None:
            """Register the new process with the guard, before it runs its program."""
            # shells let their background processes ignore SIGINT
            signal.signal(signal.SIGINT, signal.SIG_DFL)
            os.write(self._guard_pipe, guard.start_line(os.getpid(), ends_last=ends_last))

        self._starts[name] = command, {"ends_last": ends_last, **options}
        log = Path(os.devnull) if self._folder is None else self.log(name)
        with log.open("ab") as output:
            given = {"env": self._environment, "stdout": output, "stderr": output, **options}
            self._running[name] = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                start_new_session=True,
                **given,
                preexec_fn=register,  # noqa: PLW1509 - it needs no lock of another thread
            )
        return self._running[name].pid

    def start_module(self, name: str, module: str, *arguments: str, ends_last: bool = False) -> int:
        """Start a Python module under this name. Return the number of its process."""
        return self.start(name, sys.executable, "-m", module, *arguments, ends_last=ends_last)

    def stop(self, *names: str) -> list[int]:
        """End programs, and kill those that do not end in time. Return their exit codes."""
        with self._stopping:
            guard.stop_all({self._running[name].pid: self._grace for name in names})
            return [self.kill(name) for name in names]

    def kill(self, name: str) -> int:
        """Kill a program. Return its exit code: its own if it had ended already."""
        with self._stopping:
            self._running[name].kill()
            return self.wait(name)

    def wait(self, name: str) -> int:
        """Wait for the end of a program, and kill the rest of its group. Return its exit code."""
        process = self._running[name]
        code = process.wait()
        guard.send(process.pid, signal.SIGKILL)
        del self._running[name]
        os.write(self._guard_pipe, guard.end_line(process.pid))
        return code

    def kill_and_restart(self, name: str) -> int:
        """Kill a program, and start it again. Return the number of its new process."""
        self.kill(name)
        command, options = self._starts[name]
        return self.start(name, *command, **options)

    def halt(self, name: str) -> None:
        """Stop a program with SIGSTOP, so that it appears to hang."""
        guard.send(self._running[name].pid, signal.SIGSTOP)

    # --- state ------------------------------------------------------------------------------------

    def numbers(self) -> dict[str, int]:
        """Return the numbers of the programs' processes, by name."""
        return {name: process.pid for name, process in list(self._running.items())}

    def check(self) -> None:
        """Raise ProgramEnded if a program ended although it was not stopped."""
        with self._stopping:
            for name, process in list(self._running.items()):
                if process.poll() is not None:
                    raise ProgramEnded(f"{name} has ended: see {self.log(name)}")

    def wait_until_handled(
        self, sender: Sender, *messages: Message[Any, Any], timeout: float = START_TIME
    ) -> None:
        """Wait until each of the messages has a handler. Raises ProgramEnded and Timeout."""
        deadline = time.monotonic() + timeout
        while True:
            self.check()
            try:
                return sender.wait_until_handled(*messages, timeout=_CHECK_SECONDS)
            except Timeout:
                if time.monotonic() > deadline:
                    raise

    def watch(self, task: SentTask[Any], period: float = 0.1) -> Iterator[bool]:
        """Yield False every *period* seconds until a task has ended, then True.

        Raises ProgramEnded if a program ends before.
        """
        while True:
            try:
                task.wait(period)
            except Timeout:
                self.check()
                yield False
            else:
                yield True
                return

    def log(self, name: str) -> Path:
        """Return the file of a program's output."""
        assert self._folder is not None, "there are no logs without a folder"
        return self._folder / f"{name.replace(' ', '_')}.log"


@contextmanager
def central_in(
    folder: Path, prefix: str = "", *, is_fresh: bool = True
) -> Iterator[tuple[str, Programs]]:
    """A context with a central of its own: yields its address, and the group for more programs.

    Args:
        folder: the place of the journal and the logs.
        prefix: the start of their names there.
        is_fresh: whether to start a new run. False: an unfinished run continues, as after central
            was killed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="show") as sockets:
        address = f"ipc://{sockets}/central.sock"
        with Programs(folder, address=address) as programs:
            options = ["--journal", str(folder / f"{prefix}journal"), *["--fresh"] * is_fresh]
            programs.start_module(f"{prefix}central", "tca_central", *options, ends_last=True)
            os.environ[IS_STARTED_VARIABLE] = "1"  # for modules in this process
            try:
                yield address, programs
            finally:
                os.environ.pop(IS_STARTED_VARIABLE, None)
