"""Terminals: type a page's commands, and compare what their programs print.

All programs of a terminal write to one file, so their lines keep their order.
"""

import re
import shlex
import signal
import socket
import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from docs.steps import File, Step
from processes import Process

SOON = 40.0
CALM = 5
"""Looks at the programs, 10 ms apart, that must find all of them waiting before the next command."""
NOISE = {
    r"\d{6}-[\dT-]+": "JOURNAL",
    r"run [0-9a-f]{16}": "run ID",
    r"ipc:\S+": "ADDRESS",
    r"http:\S+": "ADDRESS",
    r" in /\S+": " in FOLDER",
    r"\b[\w-]+:\d+\b": "PROCESS",
    r"^run +\| \w+ started \(process \d+\)": "run | PROGRAM started",
    r"^\[(\d)\] \d+": r"[\1] PROCESS",
    r": (killed|cancelled|ends when its running handlers have returned)$": ": KILLED",
    r"\d+ events": "events",
    r"memory \d+(\.\d+)? \w+": "memory",
    r"\d+(\.\d+)?( ms\b| s\b| µs)": "SECONDS",
    r"\d+\.\d+(-(\d+\.\d+)?)?": "SECONDS",
    r"^(\S.*?) +[█▒░] ?.*": r"\1",
    r"(?<=SECONDS) \(still running\)": "",  # unless the chart ends before the present
    r"^ .*[█▒░╵].*|^ +SECONDS.*|^( +\d+ s)+$": "",
    r"\.+ +\[100%\]": "PASSED",
    r"(?<!\S)-+(?!\S)|^ {9,}": " ",  # in the head of a table, which is as wide as its numbers
    r"(sent )?to start": "to start",
    r"(?<=\S) {2,}": " ",
    r"^ +\.\.\.$": "...",
}
"""What differs from run to run, and what stands for it."""


def plain(line: str, *, all_numbers: bool = False) -> str:
    """Return a printed line without what differs from run to run."""
    for pattern, instead in NOISE.items():
        line = re.sub(pattern, instead, line)
    return (re.sub(r"SECONDS|\d+%?", "N", line) if all_numbers else line).rstrip()


def plain_lines(lines: Sequence[str], *, all_numbers: bool) -> list[str]:
    """Return the lines without what differs, and without empty ones."""
    plains = [plain(line, all_numbers=all_numbers) for line in lines]
    return [line for line in plains if line]


def match(expected: Sequence[str], lines: Sequence[str]) -> int | None:
    """Return how many of the lines are the expected ones; None if the lines do not begin so."""
    if not expected:
        return 0
    first, *rest = expected
    if first == "...":
        for skipped in range(len(lines) + 1):
            if (found := match(rest, lines[skipped:])) is not None:
                return skipped + found
        return None
    if not lines or lines[0] != first:
        return None
    found = match(rest, lines[1:])
    return None if found is None else 1 + found


def match_of_two(expected: Sequence[str], lines: Sequence[str]) -> int | None:
    """Compare the lines of two programs that print at nearly the same time: one indents its own."""
    number = len(expected)
    if "..." in expected or len(lines) < number:
        return None

    def of_each(both: Sequence[str]) -> tuple[list[str], list[str]]:
        return [one for one in both if one[0] == " "], [one for one in both if one[0] != " "]

    return number if of_each(expected) == of_each(lines[:number]) else None


@dataclass
class Terminal:
    """A shell with one file of output."""

    folder: Path
    log: Path
    environment: dict[str, str]
    foreground: Process | None = None
    jobs: list[Process] = field(default_factory=list)
    has_read: int = 0
    is_compared: bool = False
    tells_jobs: bool = True

    def lines(self) -> list[str]:
        """Return the lines that were not read yet."""
        whole = self.log.read_text().rpartition("\n")[0] if self.log.exists() else ""
        return whole.splitlines()[self.has_read :]

    def skip(self, number: int, *, all_numbers: bool) -> None:
        """Read as many lines that are not empty."""
        for line in self.lines():
            if number == 0:
                return
            self.has_read += 1
            number -= bool(plain(line, all_numbers=all_numbers))

    def write(self, line: str) -> None:
        with self.log.open("a") as file:
            file.write(f"{line}\n")

    def processes(self) -> list[Process]:
        return [*self.jobs, *([self.foreground] if self.foreground is not None else [])]

    def start(self, words: list[str], *, in_background: bool) -> None:
        command = {
            "python": words[1:],
            "pytest": [sys.executable, "-m", *words],  # a new process, which nothing has prepared
        }.get(words[0], words)
        process = Process(*command, cwd=self.folder, log=self.log, environment=self.environment)
        if in_background:
            self.jobs.append(process)
            if self.tells_jobs:
                self.write(f"[{len(self.jobs)}] {process.pid}")
        else:
            self.foreground = process

    def interrupt(self) -> None:
        assert self.foreground is not None
        self.foreground.send_signal(signal.SIGINT)
        self.end_of_foreground()
        self.has_read += len(self.lines())

    def end_of_foreground(self) -> None:
        """Wait for the end of the program in the foreground."""
        if self.foreground is not None:
            self.foreground.wait(SOON)
            self.foreground.close()
            self.foreground = None

    def end_jobs(self) -> None:
        """End the programs in the background."""
        for process in self.jobs:
            process.terminate()
        for process in self.jobs:
            process.wait(SOON)
            process.close()
        self.jobs.clear()
        self.has_read += len(self.lines())

    def close(self) -> None:
        """End all programs."""
        self.end_jobs()
        if self.foreground is not None:
            self.foreground.send_signal(signal.SIGINT)
            self.end_of_foreground()


def is_waiting(process: int) -> bool:
    """Return whether no thread of a process wants the processor or the disk."""
    try:
        files = [file.read_text() for file in Path(f"/proc/{process}/task").glob("*/stat")]
    except OSError:  # a thread has ended
        return False
    return not {file.rpartition(")")[2].split()[0] for file in files} & {"R", "D"}


class Player:
    """The reader at the terminals, in the folder ``robot``."""

    def __init__(
        self,
        folder: Path,
        *,
        columns: int = 136,
        all_numbers: bool = False,
        tells_jobs: bool = True,
    ) -> None:
        self.folder, self.all_numbers, self.tells_jobs = folder / "robot", all_numbers, tells_jobs
        self.environment = {
            "XDG_STATE_HOME": str(folder / "state"),
            "XDG_RUNTIME_DIR": str(folder),
            "BROWSER": "true %s",
            "COLUMNS": str(columns),
        }
        self.folder.mkdir()
        self.terminals: dict[str, Terminal] = {}

    def play(self, steps: Iterable[File | Step]) -> None:
        try:
            for step in steps:
                if isinstance(step, File):
                    path = self.folder / step.name
                    path.parent.mkdir(exist_ok=True)
                    path.write_text(step.text)
                else:
                    self.take(step)
            self.settle()
            for terminal in self.terminals.values():
                if terminal.foreground is not None and terminal.foreground.poll() is not None:
                    self.check_rest(terminal)
        finally:
            for terminal in reversed(self.terminals.values()):
                terminal.close()

    def take(self, step: Step) -> None:
        log = self.folder.parent / f"{step.terminal.replace('/', '-')}.log"
        terminal = self.terminals.setdefault(
            step.terminal,
            Terminal(self.folder, log, self.environment, tells_jobs=self.tells_jobs),
        )
        if step.command == "^C":
            terminal.interrupt()
        elif step.command:
            self.type(terminal, step.command.removeprefix("$ "))
        self.read(terminal, step)

    def type(self, terminal: Terminal, command: str) -> None:
        terminal.end_of_foreground()
        self.settle()
        if not terminal.jobs:
            self.check_rest(terminal)
            terminal.has_read += len(terminal.lines())
        words = shlex.split(command)
        if words[0] == "pkill":
            self.kill_central()
        elif command == "kill $(jobs -p)":
            terminal.end_jobs()
        else:
            in_background = words[-1] == "&"
            terminal.start([word for word in words if word != "&"], in_background=in_background)
            if words[:2] == ["tca", "central"] and "--stop" not in words:
                self.await_central()

    def check_rest(self, terminal: Terminal) -> None:
        """Check that nothing was printed after lines that were compared."""
        more = plain_lines(terminal.lines(), all_numbers=self.all_numbers)
        assert not terminal.is_compared or more == [], (terminal.log.stem, more)

    def settle(self) -> None:
        """Wait until all programs wait: for a message, for some time, or for the user.

        Without ``/proc``, this is only a short pause.
        """
        end = time.monotonic() + SOON
        calm = 0
        while calm < CALM:
            assert time.monotonic() < end
            calm = calm + 1 if all(map(is_waiting, self.processes())) else 0
            time.sleep(0.01)

    def processes(self) -> list[int]:
        every = [one for terminal in self.terminals.values() for one in terminal.processes()]
        return [process.pid for process in every if process.poll() is None]

    def await_central(self) -> None:
        """Wait until central listens. Modules that find none try again at long intervals."""
        end = time.monotonic() + SOON
        with socket.socket(socket.AF_UNIX) as connection:
            while connection.connect_ex(str(self.folder.parent / "tca/central.sock")):
                assert time.monotonic() < end
                time.sleep(0.01)

    def kill_central(self) -> None:
        terminal = self.terminals["Terminal 1"]
        assert terminal.foreground is not None
        terminal.foreground.kill()
        terminal.end_of_foreground()
        terminal.has_read += len(terminal.lines())
        terminal.write("Killed")

    def read(self, terminal: Terminal, step: Step) -> None:
        """Wait until the lines are there."""
        expected = plain_lines(step.printed, all_numbers=self.all_numbers)
        terminal.is_compared = bool(expected)
        end = time.monotonic() + SOON
        while True:
            has_ended = not any(one.poll() is None for one in terminal.processes())
            lines = plain_lines(terminal.lines(), all_numbers=self.all_numbers)
            found = match(expected, lines)
            if found is None and terminal.jobs:
                found = match_of_two(expected, lines)
            if found is not None:
                terminal.skip(found, all_numbers=self.all_numbers)
                if expected[-1:] == ["..."]:
                    terminal.end_of_foreground()
                    terminal.has_read += len(terminal.lines())
                return
            if has_ended or time.monotonic() > end:
                assert lines == expected, (step.terminal, step.command, lines)
            time.sleep(0.02)
