"""The output of one program in a file of bounded size, each line with its time."""

import logging
from collections.abc import Callable
from logging.handlers import RotatingFileHandler
from pathlib import Path

MOST_BYTES = 10 << 20
"""Bytes of a file. Then it is renamed to NAME.log.1, and a new one begins."""
OLDER_FILES = 4


class LogFile(RotatingFileHandler):
    """A file ``NAME.log`` with older files beside it.

    Args:
        path: the file.
        on_error: is called with a line of text, once, when the file can't be written.
    """

    def __init__(self, path: Path, on_error: Callable[[str], object]) -> None:
        super().__init__(
            path, maxBytes=MOST_BYTES, backupCount=OLDER_FILES, encoding="utf-8", delay=True
        )
        self.setFormatter(logging.Formatter("%(asctime)s %(message)s"))
        self._on_error: Callable[[str], object] | None = on_error

    def write(self, line: bytes) -> None:
        """Append a line of a program."""
        self.handle(logging.makeLogRecord({"msg": line.decode(errors="backslashreplace")}))

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802 - logging calls it so
        """Report the first error. Further lines are tried, and lost while the disk has no room."""
        del record
        if self._on_error is not None:
            on_error, self._on_error = self._on_error, None
            on_error(f"{self.baseFilename} can't be written: lines are missing there")
