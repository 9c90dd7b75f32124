"""The table of dev/records/turtle-listings.md. Each listing of the paper has a test, and a counterpart that is no
longer than the listing.
"""

import ast
import io
import re
import tokenize
from pathlib import Path
from typing import NamedTuple

import pytest

import tca_behaviours.missions
from tca_behaviours.missions import Environment, charts

ROOT = Path(__file__).parents[2]
TURTLE = ROOT / "robots" / "turtle_sim"
PAGE = (ROOT / "docs/robots/turtle.md").read_text()
LISTINGS = (ROOT / "dev/records/turtle-listings.md").read_text()
NO_CODE = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENCODING,
    tokenize.ENDMARKER,
}


class Row(NamedTuple):
    listing: str
    there: int
    here: int
    files: list[str]
    test: str


def rows() -> list[Row]:
    found = []
    for line in LISTINGS.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == 5 and cells[1].isdecimal():
            found.append(
                Row(
                    cells[0],
                    int(cells[1]),
                    int(cells[2]),
                    re.findall(r"`([^`]+)`", cells[3]),
                    cells[4],
                )
            )
    return found


ROWS = rows()


def code_lines(place: str) -> int:
    """Return the lines of code of a file, or of one of its functions or classes (`file: name`).

    Blank lines, comments and docstrings do not count.
    """
    file, _, name = place.partition(": ")
    text = next(path for path in (TURTLE / file, ROOT / file) if path.exists()).read_text()
    if not file.endswith(".py"):
        return len([line for line in text.splitlines() if line and not line.startswith("#")])
    tree = ast.parse(text)
    nodes: list[ast.AST] = [tree]
    if name:
        (part,) = [
            one
            for one in tree.body
            if isinstance(one, ast.FunctionDef | ast.ClassDef) and one.name == name
        ]
        nodes = list(part.body) if isinstance(part, ast.FunctionDef) else [part]
    code = lines_with_code(text)
    if name:
        wanted = {line for node in nodes for line in range(node.lineno, (node.end_lineno or 0) + 1)}  # type: ignore[attr-defined]
        code &= wanted
    return len(code)


def lines_with_code(text: str) -> set[int]:
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in NO_CODE:
            lines |= set(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(text)):
        if (
            isinstance(node, ast.Expr)
            and isinstance(node.value, ast.Constant)
            and isinstance(node.value.value, str)
        ):
            lines -= set(range(node.lineno, (node.end_lineno or 0) + 1))
    return lines


def test_listings_cover_all_sections_of_the_paper() -> None:
    sections = {row.listing.split()[0] for row in ROWS}
    assert sections >= {
        "2.3",
        "3.2",
        "3.3",
        "3.5",
        "3.6.7",
        "4.1",
        "4.2",
        "4.3",
        "4.4",
        "4.5",
        "4.6",
        "5.1",
        "5.2",
        "5.3",
        "5.4.1",
        "5.4.2",
    }


@pytest.mark.parametrize("row", ROWS, ids=[row.listing for row in ROWS])
def test_counterpart_is_as_short_as_its_listing(row: Row) -> None:
    assert row.here <= row.there
    if row.files:
        assert row.here == sum(code_lines(place) for place in row.files)


@pytest.mark.parametrize("row", ROWS, ids=[row.listing for row in ROWS])
def test_counterpart_has_a_test(row: Row) -> None:
    for file, test in re.findall(r"`([\w/]+\.py): (\w+)`", row.test):
        assert f"def {test}(" in (ROOT / "tests" / file).read_text(), row
    assert "`" in row.test or row.here == 0


NAMES = re.findall(r"^\|[^|]*\|(.*)\|$", PAGE.partition("## The paper's names")[2], re.MULTILINE)
OURS = sorted({name for row in NAMES for name in re.findall(r"`([A-Za-z_.]+)`", row)})


def test_listings_page_names_counterparts() -> None:
    assert len(OURS) > 25


@pytest.mark.parametrize("name", OURS)
def test_listings_page_names_exist(name: str) -> None:
    first, _, attribute = name.partition(".")
    owner = getattr(tca_behaviours.missions, first, None) or getattr(charts, first)
    made = owner() if owner is Environment else owner  # the attributes of an instance
    assert not attribute or hasattr(made, attribute)
