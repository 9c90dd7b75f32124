"""Keys that are pressed in a terminal, without Enter. Where there is no terminal there are none."""

import os
import select
import sys
import termios
import tty
from collections.abc import Iterator
from contextlib import contextmanager


class Keys:
    """What is typed, key by key."""

    def __init__(self, file: int | None) -> None:
        self._file = file

    def wait(self, seconds: float) -> str:
        """The key that is pressed within so many seconds; "" if none is."""
        if self._file is None:
            select.select([], [], [], seconds)
            return ""
        ready, _, _ = select.select([self._file], [], [], seconds)
        if not ready:
            return ""
        typed = os.read(self._file, 64)
        if not typed:  # nobody can type any more
            self._file = None
        return typed.decode(errors="replace")


@contextmanager
def typed_keys() -> Iterator[Keys]:
    """Read keys as they are typed; the terminal is as it was afterwards."""
    if not sys.stdin.isatty():
        yield Keys(None)
        return
    file = sys.stdin.fileno()
    before = termios.tcgetattr(file)
    try:
        tty.setcbreak(file)
        yield Keys(file)
    finally:
        termios.tcsetattr(file, termios.TCSADRAIN, before)
