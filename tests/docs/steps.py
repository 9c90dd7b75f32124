"""The steps of a page: the files that its reader saves, and the commands that they type.

A block with the title "Terminal 2" holds what is typed there, and what is then printed there. The
line ``^C`` is Ctrl-C, and a line ``...`` stands for any lines.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from docs.pages import QUOTE, ROOT, Block

EXAMPLES = ROOT / "examples"


class Step(NamedTuple):
    """A command, or None to read only; and the lines that are then printed."""

    terminal: str
    command: str | None
    printed: list[str]
    quoted: Path | None


class File(NamedTuple):
    """A file that the reader saves."""

    name: str
    text: str


def steps_of(blocks: Iterable[Block]) -> Iterator[File | Step]:
    """Yield what blocks have the reader save, type and read. An untitled one is a terminal itself."""
    for block in blocks:
        if block.language in {"python", "toml"} and block.title:
            text = block.text
            if quoted := QUOTE.search(text):
                path = EXAMPLES / quoted["file"]
                assert path.match(block.title), block.where
                text = path.read_text()
            yield File(block.title, text)
        elif block.language == "console" and block.title != "Any terminal":
            yield from _steps_in(block.title or block.where, block.text.splitlines())


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
