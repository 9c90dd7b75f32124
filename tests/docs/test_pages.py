"""Pages are short, their programs run as printed, and their commands exist."""

import re
import shlex
from pathlib import Path

import click
import pytest
from docs.pages import BLOCKS, PAGES, PROGRAMS, QUOTE, ROOT, Block
from module.real_central import RealCentral
from processes import run

from tca_tools.command_line import main

LONG = {"docs/reference/protocol.md": 5_300, "docs/from/tca.md": 5_000}
"""The pages that may have more than 2,000 words."""
COMMAND = re.compile(r"^\$ (?P<words>tca .*?)(?: #.*| &)?$", re.MULTILINE)
COMMANDS = [
    (block.where, found["words"])
    for block in BLOCKS
    if block.language == "console"
    for found in COMMAND.finditer(block.text)
]


def ids(block: Block) -> str:
    return block.where


def test_pages_have_few_words() -> None:
    words = {str(page.relative_to(ROOT)): len(page.read_text().split()) for page in PAGES}
    assert {page: n for page, n in words.items() if n > LONG.get(page, 2_000)} == {}
    assert sum(words.values()) <= 45_000


def test_readme_has_120_lines() -> None:
    assert len((ROOT / "README.md").read_text().splitlines()) <= 120


@pytest.mark.slow
@pytest.mark.parametrize("block", PROGRAMS, ids=ids)
def test_program_of_a_page_runs_as_printed(block: Block, tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(block.text)
    with RealCentral(f"ipc://{tmp_path}/central.sock") as daemon:
        done = run(str(program), TCA_CENTRAL=daemon.address)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(("where", "words"), COMMANDS, ids=[where for where, _ in COMMANDS])
def test_command_of_a_page_exists(where: str, words: str) -> None:
    """Find the command, its subcommands and its options, without running it."""
    _, *rest = shlex.split(words.split(" | ", maxsplit=1)[0].split(" > ", maxsplit=1)[0])
    command: click.Command = main
    context = click.Context(main)
    while rest and isinstance(command, click.Group) and not rest[0].startswith("-"):
        found = command.get_command(context, rest.pop(0))
        assert found is not None, words
        command = found
    known = {
        name for one in command.get_params(context) for name in (*one.opts, *one.secondary_opts)
    }
    given = {word.partition("=")[0] for word in rest if word.startswith("-") and word != "-"}
    assert given <= known | {"--help"}, words


def test_examples_quoted_by_pages_are_the_examples() -> None:
    """Every example is quoted or named by a page."""
    texts = "\n".join(page.read_text() for page in (*PAGES, ROOT / "examples/README.md"))
    quoted = {found["file"] for found in QUOTE.finditer(texts)}
    examples = {path.name for path in (ROOT / "examples").glob("*.py")}
    assert {name for name in examples if name not in quoted and name not in texts} == set()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_tables_of_a_page_are_apart(page: Path) -> None:
    """Two tables without an empty line between them become one."""
    tables = re.findall(r"(?:^\|.*\n)+", page.read_text(), re.MULTILINE)
    assert [one for one in tables if len(re.findall(r"^\|[-|: ]+\|$", one, re.MULTILINE)) > 1] == []


def test_navigation_has_all_pages() -> None:
    named = set(re.findall(r'"([\w/-]+\.md)"', (ROOT / "zensical.toml").read_text()))
    assert named == {str(page.relative_to(ROOT / "docs")) for page in PAGES[1:]}
