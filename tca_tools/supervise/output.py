"""The output of several programs on one screen, line by line, each line with its program's name."""

import os
import selectors
import threading
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path

from tca_tools.supervise.log_file import LogFile

MOST_WAITING = 4 << 20
"""Bytes buffered for a slow screen. Further lines are dropped: no program may wait for a reader."""
LONGEST_LINE = 16 << 10
LAST_LINES = 10
_AT_ONCE = 1 << 16

_COLOURS = (36, 33, 32, 35, 34, 96, 93, 92, 95, 94)
_RESET = b"\x1b[0m"


class Output:
    """Lines for a file descriptor. A thread writes them, so no caller waits for the screen.

    The lines of a name in *logs* are also written to that file.
    """

    def __init__(
        self, names: list[str], file: int, *, in_colour: bool, logs: Mapping[str, Path] = {}
    ) -> None:
        width = max(map(len, names))
        self._prefixes = {name: f"{name:{width}} | ".encode() for name in names}
        if in_colour:
            for number, name in enumerate(names):
                colour = f"\x1b[{_COLOURS[number % len(_COLOURS)]}m".encode()
                self._prefixes[name] = colour + self._prefixes[name] + _RESET
        self._end = _RESET + b"\n" if in_colour else b"\n"
        self._file = file
        self._logs = {name: LogFile(path, self._report) for name, path in logs.items()}
        self._waiting = bytearray()
        self._dropped = 0
        self._is_over = False
        self._changed = threading.Condition()
        self._pipes = selectors.DefaultSelector()  #: the programs' output
        # a daemon thread: a write may block for ever
        self._thread = threading.Thread(target=self._write, daemon=True)
        #: Called by the thread when the reader of the file descriptor has closed it.
        self.on_closed: Callable[[], object] = lambda: None
        self.is_closed = False

    def start(self) -> None:
        """Start to read and to write, in threads."""
        self._thread.start()
        threading.Thread(target=self._read, daemon=True).start()

    def listen(self, name: str, pipe: int) -> "Lines":
        """Show what a program writes into a pipe, until its last writer has closed it."""
        lines = Lines(lambda line: self.show(name, line))
        self._pipes.register(pipe, selectors.EVENT_READ, lines)
        return lines

    def _read(self) -> None:
        """Read all pipes in one thread, so lines appear in the order in which they were written."""
        while True:
            for key, _ in self._pipes.select():
                if data := os.read(key.fd, _AT_ONCE):
                    key.data.feed(data)
                else:
                    self._pipes.unregister(key.fd)
                    os.close(key.fd)
                    key.data.close()

    def show(self, name: str, line: bytes) -> None:
        """Show a line of a program."""
        if (log := self._logs.get(name)) is not None:
            log.write(line)
        with self._changed:
            if len(self._waiting) > MOST_WAITING:
                self._dropped += 1
                return
            if self._dropped:
                text = b"(%d lines of all programs were dropped: the reader is slow)"
                self._add(name, text % self._dropped)
                self._dropped = 0
            self._add(name, line)
            self._changed.notify()

    def _report(self, text: str) -> None:
        """Show a line about a log file, between those of the first program."""
        with self._changed:
            self._add(next(iter(self._prefixes)), text.encode())

    def close(self, patience: float) -> None:
        """Wait until all lines are written, at most *patience* seconds."""
        with self._changed:
            self._is_over = True
            self._changed.notify()
        self._thread.join(patience)

    def _add(self, name: str, line: bytes) -> None:
        self._waiting += self._prefixes[name] + line + self._end

    def _write(self) -> None:
        while True:
            with self._changed:
                while not self._waiting:
                    if self._is_over:
                        return
                    self._changed.wait()
                data, self._waiting = self._waiting, bytearray()
            try:
                while data:
                    del data[: os.write(self._file, data)]
            except OSError:
                self.is_closed = True
                self.on_closed()
                return


class Lines:
    """The output of one process, cut into lines."""

    def __init__(self, on_line: Callable[[bytes], None]) -> None:
        self.closed = threading.Event()  #: no process can write any more
        self.last: deque[bytes] = deque(maxlen=LAST_LINES)
        self._on_line = on_line
        self._unfinished = b""

    def feed(self, data: bytes) -> None:
        """Pass on the complete lines, and pieces of a line that is too long."""
        *lines, self._unfinished = (self._unfinished + data).split(b"\n")
        for line in lines:
            self._pass_on(line)
        while len(self._unfinished) > LONGEST_LINE:
            self._pass_on(self._unfinished[:LONGEST_LINE])
            self._unfinished = self._unfinished[LONGEST_LINE:]

    def close(self) -> None:
        """Pass on the last line, even without a line end."""
        if self._unfinished:
            self._pass_on(self._unfinished)
        self.closed.set()

    def _pass_on(self, line: bytes) -> None:
        line = line.rstrip(b"\r")
        self.last.append(line)
        self._on_line(line)
