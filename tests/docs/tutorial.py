"""Play a page of the tutorial: save its files, and type its commands into its terminals.

A block with the title "Terminal 2" holds what is typed there, and what is then printed there. The
line ``^C`` is Ctrl-C, and a line ``...`` stands for any lines. All programs of a terminal write to one
file, so their lines keep their order. Printed lines that are quoted from ``examples/tutorial/printed``
can be rewritten.
"""

import os
import re
import shlex
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from docs.pages import DOCS, QUOTE, ROOT, Block, blocks
from processes import Process

EXAMPLES = ROOT / "examples"
PAGES = sorted((DOCS / "tutorial").glob("*.md"))
TITLE = re.compile(r'title="([^"]+)"')
SOON = 40.0
HUMAN = 0.4
"""Seconds between two commands, in which a program that was started gets ready."""
NOISE = {
    r"\d{6}-[\dT-]+": "JOURNAL",
    r"run [0-9a-f]{16}": "run ID",
    r"ipc:\S+": "ADDRESS",
    r"http:\S+": "ADDRESS",
    r" in /\S+": " in FOLDER",
    r"\b[\w-]+:\d+\b": "PROCESS",
    r"^run +\| \w+ started \(process \d+\)": "run | PROGRAM started",
    r"^\[(\d)\] \d+": r"[\1] PROCESS",
    r": (killed|ends when its running handlers have returned)$": ": KILLED",
    r"\d+ events": "events",
    r"memory \d+(\.\d+)? \w+": "memory",
    r"\d+(\.\d+)?( ms\b| s\b)": "SECONDS",
    r"\d+\.\d+(-(\d+\.\d+)?)?": "SECONDS",
    r"^(\S.*?) +[█▒░] ?.*": r"\1",
    r"(?<=SECONDS) \(still running\)": "",  # unless the chart ends before the present
    r"^ .*[█▒░╵].*|^ +SECONDS.*|^( +\d+ s)+$": "",
    r"\.+ +\[100%\]": "PASSED",
    r"(?<=\S) {2,}": " ",
}
"""What differs from run to run, and what stands for it."""


class Step(NamedTuple):
    """A command, or None to read only; and the lines that are then printed."""

    terminal: str
    command: str | None
    printed: list[str]
    quoted: Path | None


def title_of(block: Block) -> str:
    line = block.page.read_text().splitlines()[block.line - 1]
    found = TITLE.search(line)
    return found[1] if found else ""


class File(NamedTuple):
    """A file that the reader saves."""

    name: str
    text: str


def steps_of(page: Path) -> Iterator[File | Step]:
    """Yield what a page has its reader save, type and read, in the order of the page."""
    for block in blocks(page):
        title = title_of(block)
        if block.language in {"python", "toml"} and (quoted := QUOTE.search(block.text)):
            path = EXAMPLES / quoted["file"]
            assert title == path.name, block.where
            yield File(title, path.read_text())
        elif block.language == "console" and title.startswith("Terminal"):
            yield from _steps_in(title, block.text.splitlines())


def _steps_in(terminal: str, lines: list[str]) -> Iterator[Step]:
    command: str | None = None
    printed: list[str] = []
    quoted: Path | None = None
    for line in lines:
        if line.startswith("$ ") or line == "^C":
            if command or printed:
                yield Step(terminal, command, printed, quoted)
            command, printed, quoted = line, [], None
        elif found := QUOTE.search(line):
            quoted = EXAMPLES / found["file"]
            printed += quoted.read_text().splitlines() if quoted.exists() else ["?"]
        else:
            printed.append(line)
    yield Step(terminal, command, printed, quoted)


def plain(line: str, *, all_numbers: bool = False) -> str:
    """Return a printed line without what differs from run to run."""
    for pattern, instead in NOISE.items():
        line = re.sub(pattern, instead, line)
    return (re.sub(r"\d+", "N", line) if all_numbers else line).rstrip()


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

    def start(self, words: list[str], *, in_background: bool) -> None:
        command = {
            "python": words[1:],
            "pytest": [sys.executable, "-m", *words],  # a new process, which nothing has prepared
        }.get(words[0], words)
        process = Process(*command, cwd=self.folder, log=self.log, environment=self.environment)
        if in_background:
            self.jobs.append(process)
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


class Player:
    """The reader at the terminals. *rewrite* replaces the quoted outputs by what is printed."""

    def __init__(self, page: Path, folder: Path, *, rewrite: bool = False) -> None:
        self.page, self.folder, self.rewrite = page, folder / "robot", rewrite
        self.all_numbers = page.stem.startswith("5")
        self.environment = {
            "XDG_STATE_HOME": str(folder / "state"),
            "XDG_RUNTIME_DIR": str(folder),
            "BROWSER": "true %s",
            "COLUMNS": "136",
        }
        self.folder.mkdir()
        for earlier in PAGES[: PAGES.index(page)]:
            self.save(earlier, self.folder)
        self.terminals: dict[str, Terminal] = {}

    @staticmethod
    def save(page: Path, folder: Path) -> None:
        """Save all files of a page."""
        for step in steps_of(page):
            if isinstance(step, File):
                (folder / step.name).write_text(step.text)

    def play(self) -> None:
        try:
            for step in steps_of(self.page):
                if isinstance(step, File):
                    (self.folder / step.name).write_text(step.text)
                else:
                    self.take(step)
            for name, terminal in self.terminals.items():
                if terminal.foreground is not None and terminal.foreground.poll() is not None:
                    assert terminal.lines() == [], name
        finally:
            for terminal in reversed(self.terminals.values()):
                terminal.close()

    def take(self, step: Step) -> None:
        terminal = self.terminals.setdefault(
            step.terminal,
            Terminal(self.folder, self.folder.parent / f"{step.terminal}.log", self.environment),
        )
        if step.command == "^C":
            terminal.interrupt()
        elif step.command:
            self.type(terminal, step.command.removeprefix("$ "))
        self.read(terminal, step)

    def type(self, terminal: Terminal, command: str) -> None:
        terminal.end_of_foreground()
        if not terminal.jobs:
            terminal.has_read += len(terminal.lines())
        words = shlex.split(command)
        if words[0] == "pkill":
            self.kill_central()
        elif command == "kill $(jobs -p)":
            terminal.end_jobs()
        else:
            is_module = words[0] == "python" and self.central_runs()
            joined = self.count_joined()
            in_background = words[-1] == "&"
            terminal.start([word for word in words if word != "&"], in_background=in_background)
            end = time.monotonic() + SOON
            while is_module and self.count_joined() == joined and time.monotonic() < end:
                time.sleep(0.01)
            time.sleep(HUMAN)

    def central_runs(self) -> bool:
        return "Terminal 1" in self.terminals

    def count_joined(self) -> int:
        """Return how many modules have joined, by central's log."""
        logs = [one.log.read_text() for one in self.terminals.values() if one.log.exists()]
        return sum(log.count("' joined") for log in logs)

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
        end = time.monotonic() + SOON
        if self.rewrite and step.quoted is not None:
            self.write_anew(terminal, step)
            return
        while True:
            lines = plain_lines(terminal.lines(), all_numbers=self.all_numbers)
            found = match(expected, lines)
            if found is None and terminal.jobs:
                found = match_of_two(expected, lines)
            if found is not None:
                terminal.skip(found, all_numbers=self.all_numbers)
                return
            if time.monotonic() > end:
                assert lines == expected, (self.page.name, step.terminal, step.command, lines)
            time.sleep(0.02)

    def write_anew(self, terminal: Terminal, step: Step) -> None:
        """Replace the quoted lines by those that are printed until nothing more comes."""
        assert step.quoted is not None
        begin = since = time.monotonic()
        seen = 0
        while time.monotonic() < min(since + 2.5, begin + 8) or not terminal.lines():
            if len(terminal.lines()) > seen:
                seen, since = len(terminal.lines()), time.monotonic()
            if terminal.foreground is not None and terminal.foreground.poll() is not None:
                break
            time.sleep(0.02)
        lines = terminal.lines()
        terminal.has_read += len(lines)
        if step.printed[0] == "...":
            lines = lines[1 - len(step.printed) :]
        text = "\n".join(lines) + "\n"
        text = text.replace(f"{self.folder.parent}/state", "/home/you/.local/state")
        text = text.replace(f"{self.folder.parent}/tca", "/run/user/1000/tca")
        text = text.replace(f"{self.folder}", "/home/you/robot")
        text = re.sub(rf"\b{os.uname().nodename}:(?=\d)", "laptop:", text)
        step.quoted.write_text(text)
