"""Pages, docstrings and comments name only existing files."""

import ast
import io
import re
import subprocess
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

from dev.site.parts import PARTS_BY_NAME

ROOT = Path(__file__).parent.parent
NAME = re.compile(
    r"(?<![\w/.*{<-])((?:[\w.-]+/)*[\w-]+\.(?:py|md|js|css|html|sh|toml|cfg|txt))\b(?![\w*/(])"
)
OF_USERS = {
    "FILE.py",
    "MODEL.toml",
    "arm.py",
    "cart_server.py",
    "cart_tasks.py",
    "deliver.py",
    "notes.txt",
    "panel.py",
    "run.html",
    "to_and_fro.py",
}
"""Files that readers of pages create."""
HISTORY = {"CHANGELOG.md", "docs/decisions/0106-five-packages.md"}
"""Pages that may name removed files."""


def tracked() -> list[str]:
    found = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False
    ).stdout.split()
    return [name for name in found if (ROOT / name).is_file()]


def named(text: str) -> set[str]:
    return {re.sub(r"^(\.\.?/)+", "", found) for found in NAME.findall(text)}


def prose(path: Path, text: str) -> Iterator[str]:
    """Yield the sentences of a page, or the comments and docstrings of a program."""
    if path.suffix == ".md":
        yield re.sub(r"^```.*?^```$|^    [^\n]*$", "", text, flags=re.MULTILINE | re.DOTALL)
        return
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            yield token.string
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            yield ast.get_docstring(node) or ""


def test_files_named_in_prose_exist() -> None:
    names = tracked()
    if not names:
        pytest.skip("this is no git checkout")
    known = {
        "/".join(parts[start:])
        for parts in (name.split("/") for name in names)
        for start in range(len(parts))
    }
    known |= OF_USERS | {f"{part}.md" for part in PARTS_BY_NAME}
    texts = {
        name: (ROOT / name).read_text()
        for name in names
        if name.endswith((".md", ".py")) and name not in HISTORY
    }
    missing = {
        (name, found)
        for name, text in texts.items()
        if not named(text) <= known  # parse only files that may fail
        for words in prose(ROOT / name, text)
        for found in named(words) - known
    }
    assert missing == set()
