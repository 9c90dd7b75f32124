"""Tables and texts of Markdown, for the generated parts of the reference."""

import re
from collections.abc import Iterable, Sequence

ROLE = re.compile(r"``(.+?)``")
OUTSIDE = re.compile(r"`[^`]*`|(\|)")
"""A bar outside of code, or code."""


def table(titles: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table. Cells may have line ends and bars."""
    lines = [titles, ["---"] * len(titles), *([cell(one) for one in row] for row in rows)]
    return "".join(f"| {' | '.join(map(str, line))} |\n" for line in lines)


def cell(value: object) -> str:
    """Return a text for one cell."""
    return OUTSIDE.sub(lambda found: "\\|" if found[1] else found[0], flowing(str(value)))


def flowing(text: str) -> str:
    """Return the text of a docstring on one line, as Markdown."""
    return " ".join(ROLE.sub(r"`\1`", text).split())


def code(text: object) -> str:
    """Return a text as code; nothing for an empty text."""
    return f"`{text}`" if str(text) else ""


def sentence(text: str) -> str:
    """Return a text with a capital letter and a full stop."""
    text = flowing(text)
    return text[:1].upper() + text[1:] + ("" if text.endswith((".", "!", ":")) or not text else ".")
