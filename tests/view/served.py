"""The server of the page, in processes that need not import everything anew: one that has is forked for each."""

import multiprocessing
import os
import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from multiprocessing.connection import Connection
from pathlib import Path

from tca_tools.view.__main__ import view

_context = multiprocessing.get_context("forkserver")
_context.set_forkserver_preload(["uvicorn", "tca_tools.view.app", "tca_tools.view.runs", "view.served"])


@contextmanager
def served(arguments: Sequence[str], errors: Path) -> Iterator[str]:
    """A process that serves: its page's address. What it has to complain about is written to a file."""
    hears, says = _context.Pipe(duplex=False)
    with hears:
        process = _context.Process(target=_serve, args=(list(arguments), says, errors, dict(os.environ)))
        process.start()
        says.close()
        try:
            with open(hears.fileno(), closefd=False) as said:
                line = said.readline()
            found = re.search(r"http://\S+", line)
            assert found, (line, errors.read_text())
            yield found[0]
        finally:
            process.terminate()
            process.join()


def _serve(arguments: list[str], says: Connection, errors: Path, environment: dict[str, str]) -> None:
    """As a new process would: its output goes where that of the one from which it was forked does not."""
    os.dup2(says.fileno(), 1)
    with errors.open("a") as file:
        os.dup2(file.fileno(), 2)
    sys.stdout, sys.stderr = open(1, "w", closefd=False), open(2, "w", closefd=False)  # noqa: SIM115
    os.environ |= environment
    view.main(arguments, standalone_mode=False)
