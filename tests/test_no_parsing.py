"""Sentences are made last and read by people only: no code of ours takes one apart again, or compares one."""

import ast
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = (
    "tca_bench",
    "tca_central",
    "tca_explorer",
    "tca_live",
    "tca_module",
    "tca_properties",
    "tca_tools",
    "tca_wire",
)
TAKING_APART = {"startswith", "endswith", "partition", "rpartition", "split", "rsplit", "removeprefix", "removesuffix"}
NAMES_OF_WORDS = {"why", "text", "words", "reason", "told", "said"}
WITH_PATTERNS = {
    "tca_explorer/scenario/script.py", "tca_live/messages.py", "tca_properties/field_values.py",
    "tca_properties/language.py", "tca_tools/command_line.py", "tca_tools/drawing/page.py", "tca_tools/drawing/pictures.py",
    "tca_tools/export/mcap_file.py", "tca_wire/journal/records.py", "tca_wire/packets/codec.py",
    "tca_wire/text/plain_data.py", "tca_tools/options.py", "tca_central/shell/permissions_file.py", "tca_wire/keys.py",
}  # fmt: skip
"""Files that read what is no text of ours: names of files, what users type, foreign messages, pictures of libraries."""
ROOMS = (*(room for room in PACKAGES if room not in ("tca_wire", "tca_module")), "tca_wire/text")
TAKEN_APART = {
    "tca_bench/processes.py": 1,
    "tca_central/__main__.py": 6, "tca_central/failing/failures.py": 4, "tca_central/model/registry.py": 1,
    "tca_central/needs/texts.py": 1, "tca_central/outgoing/direct_routes.py": 1, "tca_central/requests/joining.py": 1,
    "tca_central/requests/replying.py": 1, "tca_central/requests/waiting.py": 1, "tca_central/shell/authenticator.py": 1, "tca_central/shell/gate.py": 4, "tca_central/shell/permissions_file.py": 4, "tca_central/shell/log_lines.py": 1,
    "tca_central/shell/recovery.py": 3, "tca_central/shell/server.py": 4, "tca_central/image/container.py": 3,
    "tca_central/image/layout.py": 1,
    "tca_explorer/scenario/requests.py": 1, "tca_explorer/scenario/scenario.py": 1,
    "tca_explorer/scenario/script.py": 1, "tca_explorer/search/exploration.py": 1, "tca_live/messages.py": 1,
    "tca_live/questions.py": 3, "tca_live/shared.py": 1, "tca_live/top.py": 1, "tca_properties/field_values.py": 2,
    "tca_properties/language.py": 8, "tca_properties/predicates.py": 9, "tca_tools/check/missions.py": 1, "tca_tools/command_line.py": 3,
    "tca_tools/drawing/graphviz.py": 1, "tca_tools/drawing/pictures.py": 1, "tca_tools/drawing/svg.py": 1, "tca_tools/export/schemas.py": 1,
    "tca_tools/export/tables.py": 2, "tca_tools/gantt/text.py": 1, "tca_tools/replay/app.py": 1,
    "tca_tools/run/journals.py": 1, "tca_tools/run/records.py": 1, "tca_tools/stats/text.py": 1,
    "tca_tools/tasktree_viz/text.py": 1, "tca_tools/tasktree_viz/words.py": 1, "tca_tools/terminal.py": 1,
    "tca_tools/view/answers.py": 1, "tca_tools/view/columns.py": 2, "tca_tools/view/pictures.py": 2, "tca_tools/view/runs.py": 2,
    "tca_wire/text/early_work.py": 1, "tca_wire/text/facts_in_words.py": 2, "tca_wire/text/plain_data.py": 1,
}  # fmt: skip
"""How often a file of these rooms takes a text apart or compares one: addresses, names of parts and modules, what is
typed, tracebacks, foreign messages, guides of drawings. These numbers may only become less.
"""
PAGE = {
    "details.js": 2, "machine.js": 1, "main.js": 2, "notes.js": 1, "search.js": 5, "steer.js": 1, "store.js": 2,
    "words.js": 2,
}  # fmt: skip
"""The same of the page: what is typed, names of columns and keys, marks in tracebacks; words.js looks for links in texts."""


@pytest.mark.parametrize("package", PACKAGES)
def test_only_files_that_read_foreign_text_have_patterns(package: str) -> None:
    for path in (ROOT / package).rglob("*.py"):
        if re.search(r"^(import re$|from re import)", path.read_text(), re.MULTILINE):
            assert str(path.relative_to(ROOT)) in WITH_PATTERNS


def is_reading(node: ast.AST) -> bool:
    """Whether an expression takes a text apart, compares it with words of several, or looks for some in it."""
    if isinstance(node, ast.Attribute):
        return node.attr in TAKING_APART
    if not isinstance(node, ast.Compare):
        return False
    sides = (node.left, *node.comparators)
    if isinstance(node.ops[0], ast.Eq | ast.NotEq):
        return any(isinstance(one, ast.Constant) and " " in str(one.value).strip() for one in sides)
    if not isinstance(node.ops[0], ast.In | ast.NotIn) or not isinstance(node.left, ast.Constant):
        return False
    place = node.comparators[0]
    name = place.attr if isinstance(place, ast.Attribute) else place.id if isinstance(place, ast.Name) else ""
    return " " in str(node.left.value).strip() or name in NAMES_OF_WORDS


def readings(room: str) -> Iterator[str]:
    """The files of a room, once for each such expression."""
    for path in (ROOT / room).rglob("*.py"):
        yield from (str(path.relative_to(ROOT)) for node in ast.walk(ast.parse(path.read_text())) if is_reading(node))


@pytest.mark.parametrize("room", ROOMS)
def test_texts_are_not_taken_apart(room: str) -> None:
    found = Counter(readings(room))
    assert {path: count for path, count in found.items() if count > TAKEN_APART.get(path, 0)} == {}


@pytest.mark.parametrize("code", ['fact.why != "it said goodbye"', '"gave up" in why', 'why.partition(": ")'])
def test_such_readings_are_found(code: str) -> None:
    assert any(map(is_reading, ast.walk(ast.parse(code))))


def test_the_page_takes_no_sentences_apart() -> None:
    taking = r"\.(test|split|includes|startsWith|endsWith|match|matchAll)\(|new RegExp|\.replace\(/"
    found = {
        path.name: len(re.findall(taking, path.read_text())) for path in (ROOT / "tca_tools/view/page").glob("*.js")
    }
    assert {name: count for name, count in found.items() if count > PAGE.get(name, 0)} == {}
