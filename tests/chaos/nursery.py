"""Processes that are ready at once: one that has imported everything forks the others.

``python -m chaos.nursery FOLDER`` reads lines of words from standard input, and answers each with a line: a process for
``start``, what a process ended with for ``wait`` (it was killed, or is about to end) and ``look`` (-: it lives).
"""

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

TESTS = Path(__file__).parent.parent


class Nursery:
    """Starts processes, and tells what became of them."""

    def __init__(self, folder: Path, address: str) -> None:
        environment = {**os.environ, "TCA_CENTRAL": address, "PYTHONPATH": f"{TESTS}:{TESTS.parent}"}
        self._process = subprocess.Popen(
            [sys.executable, "-m", "chaos.nursery", str(folder)], text=True, bufsize=1, env=environment,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        )  # fmt: skip

    def _ask(self, *words: object) -> str:
        assert self._process.stdin
        assert self._process.stdout
        print(*words, sep="\t", file=self._process.stdin, flush=True)
        return self._process.stdout.readline().strip()

    def start(self, what: str, *arguments: object) -> int:
        """A process that does one of DEEDS; what it prints goes to a file of that name."""
        return int(self._ask("start", what, *arguments))

    def wait(self, process: int) -> int:
        """The end of a process; as of ``os.waitstatus_to_exitcode``."""
        return int(self._ask("wait", process))

    def look(self, process: int) -> int | None:
        """What a process has ended with; None: it lives. Asked once after its end."""
        answer = self._ask("look", process)
        return None if answer == "-" else int(answer)

    def close(self) -> None:
        """All processes must have ended."""
        self._process.communicate()


def main() -> None:
    """Be the one that forks."""
    from chaos.deeds import DEEDS

    folder = Path(sys.argv[1])
    for line in sys.stdin:
        word, *rest = line.rstrip("\n").split("\t")
        if word == "start":
            process = os.fork()
            if not process:
                _become(folder, DEEDS[rest[0]], rest)
            print(process, flush=True)
        else:
            found, status = os.waitpid(int(rest[0]), 0 if word == "wait" else os.WNOHANG)
            print(os.waitstatus_to_exitcode(status) if found else "-", flush=True)


def _become(folder: Path, deed: Any, words: list[str]) -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)
    nothing = os.open(os.devnull, os.O_RDONLY)
    log = os.open(folder / f"{words[0]}.log", os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
    for number, file in enumerate((nothing, log, log)):
        os.dup2(file, number)
    sys.stdin = open(0)  # noqa: SIM115
    status = 1
    try:
        deed(folder, *words[1:])
        status = 0
    except SystemExit as error:
        status = error.code if isinstance(error.code, int) else 1
        if status:
            print(repr(error), repr(error.__cause__ or error.__context__), file=sys.stderr)
    except BaseException:  # noqa: BLE001 - it is the end of a process
        import traceback

        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        if not status:
            import atexit

            atexit._run_exitfuncs()
        os._exit(status)


if __name__ == "__main__":
    main()
