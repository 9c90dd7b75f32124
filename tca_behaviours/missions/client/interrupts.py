"""Ctrl-C in the program of a mission.

If Ctrl-C came while a task is being sent, the mission would not know the task, and could not stop
it.
"""

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType, TracebackType


@contextmanager
def delay_interrupt() -> Iterator[None]:
    """Delay the first Ctrl-C until the end of the block. A second one interrupts the block."""
    if threading.current_thread() is not threading.main_thread():
        yield  # Python runs signal handlers in the main thread only
        return
    original = signal.getsignal(signal.SIGINT)
    if original is not signal.default_int_handler:
        yield  # the program handles SIGINT itself
        return
    held: list[int] = []

    def hold(number: int, frame: FrameType | None) -> None:
        if held:
            signal.default_int_handler(number, frame)
        held.append(number)

    signal.signal(signal.SIGINT, hold)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, original)
        if held:
            signal.raise_signal(signal.SIGINT)


def report_in_one_line(text: str) -> None:
    """Print *text* in place of a traceback if Ctrl-C ends the program."""
    before = sys.excepthook

    def report(
        kind: type[BaseException], error: BaseException, trace: TracebackType | None
    ) -> None:
        if isinstance(error, KeyboardInterrupt):
            print(text, file=sys.stderr)
        else:
            before(kind, error, trace)

    sys.excepthook = report
