"""The pages of the documents, and their blocks of code."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = [
    ROOT / "README.md",
    *sorted(page for page in DOCS.rglob("*.md") if page.parent.name != "decisions"),
]
QUOTE = re.compile(r'--8<-- "(?P<file>[^":]+)(?::\w+)?"')
BLOCK = re.compile(
    r'^(?P<indent> *)```(?P<language>\w*)(?: [^\n]*?title="(?P<title>[^"]+)")?[^\n]*\n'
    r"(?P<text>.*?)^ *```$",
    re.MULTILINE | re.DOTALL,
)


class Block(NamedTuple):
    """A block of a page, as shown."""

    page: Path
    line: int
    language: str
    text: str
    title: str

    @property
    def where(self) -> str:
        return f"{self.page.relative_to(ROOT)}:{self.line}"

    @property
    def is_quote(self) -> bool:
        """Whether all lines are quoted from files."""
        return all(QUOTE.search(line) for line in self.text.splitlines() if line.strip())


def blocks(page: Path) -> Iterator[Block]:
    """Yield the fenced blocks of a page."""
    text = page.read_text()
    for found in BLOCK.finditer(text):
        line = text[: found.start()].count("\n") + 1
        lines = [one.removeprefix(found["indent"]) for one in found["text"].splitlines()]
        yield Block(page, line, found["language"], "\n".join(lines) + "\n", found["title"] or "")


BLOCKS = [block for page in PAGES for block in blocks(page)]
PROGRAMS = [block for block in BLOCKS if block.language == "python" and not block.is_quote]
