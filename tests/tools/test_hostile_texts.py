"""A journal that somebody else has written: whatever its names and texts hold, no tool lets them steer a terminal, add lines
to a line, or become part of a page or picture.
"""

import html.parser
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import msgspec
import pytest
from click.testing import CliRunner
from tools.runs import OPENED, encoded, walk
from tools.test_every_tool import TO_FILES, TO_STDOUT

from tca_tools.command_line import main
from tca_wire.journal.facts import Entry

HOSTILE = (
    "\x1b]0;mine\x07\x1b[2J\nALL IS WELL\r\u202e\x9b31m\x00"
    '</text></script><script>alert("x")</script><img src=x onerror=alert(1)>&amp;{{7*7}}'
)


def poisoned(value: Any) -> Any:
    """The same with every text, and all data, made hostile; what was different still is."""
    if isinstance(value, msgspec.Struct):
        fields = {name: poisoned(getattr(value, name)) for name in value.__struct_fields__}
        return type(value)(**fields)
    if isinstance(value, list):
        return [poisoned(one) for one in value]
    if type(value) is str and value and value[0] not in "{[":
        return value + HOSTILE
    return msgspec.msgpack.encode({HOSTILE: [HOSTILE]}) if isinstance(value, bytes) and value else value


def hostile_walk() -> list[Entry]:
    return [OPENED, *(poisoned(entry) for entry in walk()[1:])]


@pytest.fixture(scope="module")
def journal(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("hostile") / "walk.tcaj"
    path.write_bytes(encoded(hostile_walk()))
    return path


def is_calm(text: str) -> bool:
    """Whether a text is lines of characters that a terminal shows, and no line is one of the journal's."""
    return all(line.isprintable() for line in text.split("\n")) and "\nALL IS WELL" not in text


@pytest.mark.parametrize("command", TO_STDOUT)
def test_nothing_steers_a_terminal(journal: Path, command: str) -> None:
    result = CliRunner().invoke(main, [*command.split(), str(journal)], prog_name="tca")
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    assert r"\x1b" in result.stdout or "\\u001b" in result.stdout
    assert is_calm(result.stdout), [line for line in result.stdout.split("\n") if not line.isprintable()][:3]
    assert is_calm(result.stderr), result.stderr


class Tags(html.parser.HTMLParser):
    """The tags of a page that nobody who writes one here would make."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "img" or any(name.startswith("on") for name, _ in attrs):
            self.found.append(f"{tag} {attrs}")

    def handle_data(self, data: str) -> None:
        if self.lasttag == "script" and "alert(" in data and "<\\/" not in data:
            self.found.append(data[:80])


@pytest.mark.parametrize(("command", "name"), [one for one in TO_FILES if one[1] != "out.png"])
def test_nothing_becomes_part_of_a_page_or_picture(journal: Path, tmp_path: Path, command: str, name: str) -> None:
    out = tmp_path / name
    result = CliRunner().invoke(main, [*command.split(), str(journal), "-o", str(out)], prog_name="tca")
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    assert is_calm(result.stdout + result.stderr)
    assert out.exists()
    assert sorted(tmp_path.iterdir()) == [out]
    if name.endswith(".txt"):
        assert is_calm(out.read_text())
    if name.endswith(".svg"):
        ET.fromstring(out.read_text())  # well formed
        assert "<img" not in out.read_text()
        assert "<script" not in out.read_text()
    if name.endswith(".html"):
        tags = Tags()
        tags.feed(out.read_text())
        assert not tags.found, tags.found[:3]
        assert "{{7*7}}" in out.read_text()
