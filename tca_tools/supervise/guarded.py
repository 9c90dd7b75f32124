"""Processes that end with the one that has started them, however that ends: a guard sees to it."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any, Self

from tca_tools.supervise import guard

_GUARD_AGAIN = 1.0  # seconds until a guard that was killed is replaced


class GuardedProcesses:
    """Starts programs, each as the leader of a process group of its own. May be used from any thread."""

    def __init__(self, starter: str, grace: float, tell: Callable[[str], object] = lambda _: None) -> None:
        """*starter*: how people call this process; *grace*: seconds that programs have if it is killed."""
        self._command = [sys.executable, "-IS", guard.__file__, f"{grace:g}", starter]
        self._tell = tell
        self._groups: dict[int, bytes] = {}  #: the line by which the guard knows each
        self._guard_input, self._guarded = os.pipe()
        self._guarding = threading.Thread(target=self._keep_guard, daemon=True)

    def __enter__(self) -> Self:
        self._guarding.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Let the guard go: all programs have ended."""
        os.close(self._guarded)
        os.close(self._guard_input)
        self._guarding.join()

    def start(self, command: Sequence[str], *, ends_last: bool = False, **options: Any) -> "subprocess.Popen[bytes]":
        """Start a program. Raises OSError."""

        def tell_guard() -> None:
            """In the new process: from its first moment on something ends it, and can."""
            signal.signal(signal.SIGINT, signal.SIG_DFL)  # shells have what they start in the background ignore it
            os.write(self._guarded, guard.started(os.getpid(), ends_last=ends_last))

        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, start_new_session=True, **options,
            preexec_fn=tell_guard,  # noqa: PLW1509 - it needs no lock that another thread may hold
        )  # fmt: skip
        self._groups[process.pid] = guard.started(process.pid, ends_last=ends_last)
        return process

    def wait(self, process: "subprocess.Popen[bytes]") -> int:
        """Wait for the end of a program, and kill what it has left behind; its return code."""
        code = process.wait()
        guard.send(process.pid, signal.SIGKILL)
        del self._groups[process.pid]
        os.write(self._guarded, guard.gone(process.pid))
        return code

    def _keep_guard(self) -> None:
        """Replace the guard if it is killed; what that has read it forgets."""
        while code := subprocess.Popen(self._command, stdin=self._guard_input, start_new_session=True).wait():
            self._tell(f"its guard ended ({code}); another one starts")
            time.sleep(_GUARD_AGAIN)
            for line in list(self._groups.values()):
                os.write(self._guarded, line)
