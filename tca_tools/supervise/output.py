"""What many programs say, on one screen, a line at a time and by name."""

import os
import selectors
import threading
from collections import deque
from collections.abc import Callable

MOST_WAITING = 4 << 20
"""Bytes that wait for a screen that takes no more: what comes then is dropped, for no program may
wait for a reader.
"""
LONGEST_LINE = 16 << 10
LAST_LINES = 10
_AT_ONCE = 1 << 16

_COLOURS = (36, 33, 32, 35, 34, 96, 93, 92, 95, 94)
_RESET = b"\x1b[0m"


class Output:
    """Lines on their way to a file descriptor. A thread writes them, so that nobody waits."""

    def __init__(self, names: list[str], file: int, *, in_colour: bool) -> None:
        width = max(map(len, names))
        self._prefixes = {name: f"{name:{width}} | ".encode() for name in names}
        if in_colour:
            for number, name in enumerate(names):
                colour = f"\x1b[{_COLOURS[number % len(_COLOURS)]}m".encode()
                self._prefixes[name] = colour + self._prefixes[name] + _RESET
        self._end = _RESET + b"\n" if in_colour else b"\n"
        self._file = file
        self._waiting = bytearray()
        self._dropped = 0
        self._is_over = False
        self._changed = threading.Condition()
        self._pipes = selectors.DefaultSelector()  #: of programs that are listened to
        self._thread = threading.Thread(
            target=self._write, daemon=True
        )  # it may stand in a write for ever
        self.on_closed: Callable[[], object] = lambda: (
            None
        )  #: called by the thread: nobody reads any more
        self.is_closed = False

    def start(self) -> None:
        """Begin to read and to write."""
        self._thread.start()
        threading.Thread(target=self._read, daemon=True).start()

    def listen(self, name: str, pipe: int) -> "Lines":
        """Show what a program writes into a pipe, until nothing can write there any more; then
        close it.
        """
        lines = Lines(lambda line: self.put(name, line))
        self._pipes.register(pipe, selectors.EVENT_READ, lines)
        return lines

    def _read(self) -> None:
        """Read all pipes, in one thread: so lines come in the order in which they were written."""
        while True:
            for key, _ in self._pipes.select():
                if data := os.read(key.fd, _AT_ONCE):
                    key.data.feed(data)
                else:
                    self._pipes.unregister(key.fd)
                    os.close(key.fd)
                    key.data.end()

    def put(self, name: str, line: bytes) -> None:
        """Show a line of a program."""
        with self._changed:
            if len(self._waiting) > MOST_WAITING:
                self._dropped += 1
                return
            if self._dropped:
                self._add(
                    name,
                    b"(%d lines of all programs were dropped: nobody read them)" % self._dropped,
                )
                self._dropped = 0
            self._add(name, line)
            self._changed.notify()

    def close(self, patience: float) -> None:
        """Wait until all is written, for some seconds."""
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
    """What one process says, cut into lines."""

    def __init__(self, tell: Callable[[bytes], None]) -> None:
        self.over = threading.Event()  #: nothing can write there any more
        self.last: deque[bytes] = deque(maxlen=LAST_LINES)
        self._tell = tell
        self._begun = b""

    def feed(self, data: bytes) -> None:
        """Tell the lines that are complete, and pieces of one that is too long."""
        *lines, self._begun = (self._begun + data).split(b"\n")
        for line in lines:
            self._take(line)
        while len(self._begun) > LONGEST_LINE:
            self._take(self._begun[:LONGEST_LINE])
            self._begun = self._begun[LONGEST_LINE:]

    def end(self) -> None:
        """Tell what has no end of line."""
        if self._begun:
            self._take(self._begun)
        self.over.set()

    def _take(self, line: bytes) -> None:
        line = line.rstrip(b"\r")
        self.last.append(line)
        self._tell(line)
