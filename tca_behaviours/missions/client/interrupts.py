"""Ctrl-C while a task is being sent.

If Ctrl-C came before the mission knew the task, the mission could not stop the task.
"""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


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
