"""A command in its own pseudo-terminal, which tests read and type into."""

import fcntl
import os
import pty
import re
import select
import struct
import subprocess
import termios
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

SOON = 60.0


class Terminal:
    """A command and its terminal. ``unread`` is the output that no call has matched yet."""

    def __init__(self, command: Sequence[str], **environment: str) -> None:
        self.master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 40, 200, 0, 0))
        self.saved_settings = termios.tcgetattr(slave)
        self.slave = slave
        self.unread = ""
        self.process = subprocess.Popen(
            command,
            stdin=slave,
            stdout=slave,
            stderr=slave,
            start_new_session=True,
            env={**os.environ, "TERM": "xterm-256color", **environment}
            | dict.fromkeys(("COLUMNS", "LINES"), ""),
        )

    def shows(self, pattern: str) -> str:
        """Wait until *pattern* appears in the output, and return the match. Drop the output up to
        its end.
        """
        end = time.monotonic() + SOON
        while not (found := re.search(pattern, self.unread)):
            assert time.monotonic() < end, f"{pattern!r} is not in:\n{self.unread[-4000:]}"
            assert self.process.poll() is None, self.unread[-4000:]
            if select.select([self.master], [], [], 0.1)[0]:
                self.unread += re.sub(
                    r"\x1b\[[0-9;?]*[a-zA-Z]",
                    "",
                    os.read(self.master, 65536).decode(errors="replace"),
                )
        self.unread = self.unread[found.end() :]
        return found[0]

    def type(self, keys: bytes) -> None:
        os.write(self.master, keys)

    def vanish(self) -> None:
        """Disconnect the terminal, as a closed window does."""
        null = os.open(os.devnull, os.O_RDWR)
        os.dup2(null, self.master)
        os.close(null)

    def ends(self) -> int:
        """Wait for the end of the command, and return its exit code. Check that the terminal
        settings are restored.
        """
        end = time.monotonic() + SOON
        while self.process.poll() is None and time.monotonic() < end:
            if select.select([self.master], [], [], 0.1)[0]:
                os.read(self.master, 65536)
        assert termios.tcgetattr(self.slave) == self.saved_settings
        return self.process.wait(0)


@contextmanager
def terminal(command: Sequence[str], **environment: str) -> Iterator[Terminal]:
    """Run a command in a terminal, and kill it at the end of the block if it still runs."""
    shown = Terminal(command, **environment)
    try:
        yield shown
    finally:
        if shown.process.poll() is None:
            shown.process.kill()
            shown.process.wait()
        os.close(shown.master)
        os.close(shown.slave)
