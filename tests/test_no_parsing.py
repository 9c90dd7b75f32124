"""Sentences are made last and read by people only: no code of ours takes one apart again."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = ("tca_central", "tca_explorer", "tca_live", "tca_module", "tca_properties", "tca_tools", "tca_wire")
TAKING_APART = {"startswith", "endswith", "partition", "rpartition", "removeprefix", "removesuffix"}
WITH_PATTERNS = {
    "tca_explorer/scenario/script.py", "tca_live/messages.py", "tca_properties/field_values.py",
    "tca_properties/language.py", "tca_tools/command_line.py", "tca_tools/drawing/page.py", "tca_tools/drawing/pictures.py",
    "tca_tools/export/mcap_file.py", "tca_wire/journal/records.py", "tca_wire/packets/codec.py",
    "tca_wire/text/plain_data.py",
}  # fmt: skip
"""Files that read what is no text of ours: names of files, what users type, foreign messages, pictures of libraries."""
ROOMS_OF_WORDS = {
    "tca_tools/why": {},
    "tca_tools/tasktree_viz": {"text.py": 1},  # guides
    "tca_tools/replay": {"app.py": 1, "tree.py": 1},  # what is typed, guides
    "tca_tools/analysis": {},
    "tca_tools/report": {},
    "tca_tools/gantt": {},
    "tca_tools/view": {"runs.py": 2},  # addresses
}
"""How often the files that tell of runs take a text apart. These numbers may only become less."""


@pytest.mark.parametrize("package", PACKAGES)
def test_only_files_that_read_foreign_text_have_patterns(package: str) -> None:
    for path in (ROOT / package).rglob("*.py"):
        if re.search(r"^(import re|from re import)", path.read_text(), re.MULTILINE):
            assert str(path.relative_to(ROOT)) in WITH_PATTERNS


@pytest.mark.parametrize("room", ROOMS_OF_WORDS)
def test_texts_are_not_taken_apart(room: str) -> None:
    for path in (ROOT / room).rglob("*.py"):
        calls = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Attribute)]
        found = sum(node.attr in TAKING_APART for node in calls)
        assert found <= ROOMS_OF_WORDS[room].get(path.name, 0), path


def test_the_page_has_no_patterns_for_sentences() -> None:
    for path in (ROOT / "tca_tools/view/page").glob("*.js"):
        assert not re.search(r"\.(match|matchAll|startsWith|endsWith)\(|new RegExp|\.replace\(/", path.read_text()), (
            path
        )
