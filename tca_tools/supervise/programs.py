"""Programs that are started together, and end with the one who started them: of robots, shows,
benchmarks and tests.

The caller says what is to start, stop or be killed. ``tca run`` is a caller that keeps its programs
running.
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
from tca_wire.endpoint import VARIABLE

GRACE = 10.0
"""Seconds that a program has to finish what it is doing."""

START_TIME = 60.0
"""Seconds within which all programs must be there."""

_GUARD_AGAIN = 1.0  # seconds until a guard that was killed is replaced
_LOOK = 1.0
"""Seconds between two looks at whether they still are."""


class ProgramEnded(TcaError):
    """A program has ended by itself."""


class Programs:
    """Programs by name, each the leader of a process group. Leaving the block ends them, those last
    that *end last*.

    If this process is killed a guard ends them. Programs of different names may be used from
    different threads.
    """

    def __init__(
        self,
        folder: Path | None = None,
        *,
        address: str = "",
        grace: float = GRACE,
        starter: str = "their starter",
        tell: Callable[[str], object] = lambda _: None,
    ) -> None:
        """Nothing starts yet.

        Args:
            folder: the place of the logs; without one what programs print is dropped.
            address: central's, for all of them.
            grace: seconds that they have to end.
            starter: the guard's word for this process.
            tell: is told that the guard was killed.
        """
        self._folder = folder
        self._environment = {**os.environ, VARIABLE: address} if address else None
        self._grace = grace
        self._guard_command = [sys.executable, "-IS", guard.__file__, f"{grace:g}", starter]
        self._tell = tell
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        self._starts: dict[str, tuple[tuple[str, ...], dict[str, Any]]] = {}

    def __enter__(self) -> Self:
        self._guard_input, self._guarded = os.pipe()
        self._guarding = threading.Thread(target=self._keep_guard, daemon=True)
        self._guarding.start()
        return self

    def __exit__(self, *_: object) -> None:
        try:
            for ends_last in (False, True):
                self.stop(*(name for name in self._running if self._ends_last(name) == ends_last))
        finally:
            for name in list(self._running):  # Ctrl-C: somebody does not want to wait
                self.kill(name)
            os.close(self._guarded)
            os.close(self._guard_input)
            self._guarding.join()

    def _keep_guard(self) -> None:
        """Replace the guard if it is killed; what that has read it forgets."""
        while code := subprocess.Popen(
            self._guard_command, stdin=self._guard_input, start_new_session=True
        ).wait():
            self._tell(f"its guard ended ({code}); another one starts")
            time.sleep(_GUARD_AGAIN)
            for name, process in list(self._running.items()):
                os.write(self._guarded, guard.started(process.pid, ends_last=self._ends_last(name)))

    def _ends_last(self, name: str) -> bool:
        return bool(self._starts[name][1]["ends_last"])

    # --- what is to run ---------------------------------------------------------------------------

    def start(self, name: str, *command: str, ends_last: bool = False, **options: Any) -> int:
        """Start a program under this name, with options of ``subprocess.Popen``; its process.
        Raises OSError.
        """

        def tell_guard() -> None:
            """In the new process: from its first moment on something ends it, and can."""
            signal.signal(
                signal.SIGINT, signal.SIG_DFL
            )  # shells have what they start in the background ignore it
            os.write(self._guarded, guard.started(os.getpid(), ends_last=ends_last))

        self._starts[name] = command, {"ends_last": ends_last, **options}
        with (
            Path(os.devnull).open("ab")
            if self._folder is None
            else self.log(name).open("ab") as output
        ):
            given = {"env": self._environment, "stdout": output, "stderr": output, **options}
            self._running[name] = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                start_new_session=True,
                **given,
                preexec_fn=tell_guard,  # noqa: PLW1509 - it needs no lock that another thread may hold
            )
        return self._running[name].pid

    def start_module(self, name: str, module: str, *arguments: str, ends_last: bool = False) -> int:
        """Start a Python module under this name; its process."""
        return self.start(name, sys.executable, "-m", module, *arguments, ends_last=ends_last)

    def stop(self, *names: str) -> list[int]:
        """Let programs finish, and wait; those that do not end in time are killed. Their exit
        codes.
        """
        guard.end_all({self._running[name].pid: self._grace for name in names})
        return [self.kill(name) for name in names]

    def kill(self, name: str) -> int:
        """Kill a program; its exit code, if it has ended already."""
        self._running[name].kill()
        return self.wait(name)

    def wait(self, name: str) -> int:
        """Wait for the end of a program, and kill what it has left behind; its exit code."""
        process = self._running[name]
        code = process.wait()
        guard.send(process.pid, signal.SIGKILL)
        del self._running[name]
        os.write(self._guarded, guard.gone(process.pid))
        return code

    def kill_and_restart(self, name: str) -> int:
        """Kill a program, and run it once more; its new process."""
        self.kill(name)
        command, options = self._starts[name]
        return self.start(name, *command, **options)

    def halt(self, name: str) -> None:
        """Have a program stand still: it takes what it is sent, and does nothing."""
        guard.send(self._running[name].pid, signal.SIGSTOP)

    # --- how they are -----------------------------------------------------------------------------

    def numbers(self) -> dict[str, int]:
        """The numbers of the programs' processes."""
        return {name: process.pid for name, process in list(self._running.items())}

    def check(self) -> None:
        """Raise ProgramEnded if one has ended by itself."""
        for name, process in list(self._running.items()):
            if process.poll() is not None:
                raise ProgramEnded(f"{name} has ended: see {self.log(name)}")

    def wait_until_handled(
        self, sender: Sender, *messages: Message[Any, Any], timeout: float = START_TIME
    ) -> None:
        """Wait until programs handle each of these messages. Raises ProgramEnded and Timeout."""
        deadline = time.monotonic() + timeout
        while True:
            self.check()
            try:
                return sender.wait_until_handled(*messages, timeout=_LOOK)
            except Timeout:
                if time.monotonic() > deadline:
                    raise

    def looks(self, task: SentTask[Any], period: float = 0.1) -> Iterator[bool]:
        """Time to look at a task, until it has ended: whether it has. Raises ProgramEnded if a
        program does before.
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
        """The file that a program's output goes to."""
        assert self._folder is not None, "there are no logs without a folder"
        return self._folder / f"{name.replace(' ', '_')}.log"


@contextmanager
def central_in(
    folder: Path, prefix: str = "", *, is_fresh: bool = True
) -> Iterator[tuple[str, Programs]]:
    """Central, with a journal in the folder: its address, and the programs beside it.

    Args:
        folder: the place of the journal and of what the programs print.
        prefix: the beginning of their names there.
        is_fresh: a new run begins also where one is unfinished. False: it continues, as after
            central was killed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="show") as sockets:
        address = f"ipc://{sockets}/central.sock"
        with Programs(folder, address=address) as programs:
            options = ["--journal", str(folder / f"{prefix}journal"), *["--fresh"] * is_fresh]
            programs.start_module(f"{prefix}central", "tca_central", *options, ends_last=True)
            yield address, programs
