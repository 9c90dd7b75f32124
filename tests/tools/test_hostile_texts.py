"""Hostile names and texts in a foreign journal.

No tool lets such texts control a terminal, add lines to a line, or become part of a page or
picture.
"""

import html.parser
import io
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import msgspec
import pytest
from click.testing import CliRunner, Result
from mcap.reader import make_reader
from tools.runs import OPENED, encoded, walk
from tools.story import Story
from tools.test_every_tool import TO_FILES, TO_STDOUT

from tca_tools.analysis.failures import failures
from tca_tools.command_line import main
from tca_tools.export.mcap_file import write_mcap
from tca_tools.export.tables import TABLES
from tca_tools.journal.fold import History
from tca_tools.journal.journals import open_log
from tca_tools.view.answers import message_answer
from tca_tools.view.reading import Reading
from tca_wire.journal import facts
from tca_wire.journal.facts import Entry
from tca_wire.points import Moment, TaskId

HOSTILE = (
    "\x1b]0;mine\x07\x1b[2J\nALL IS WELL\r\u202e\x9b31m\x00"
    '</text></script><script>alert("x")</script><img src=x onerror=alert(1)>&amp;{{7*7}}'
)


def poisoned(value: Any) -> Any:
    """Return the value with all texts and data made hostile. Different texts stay different."""
    if isinstance(value, msgspec.Struct):
        fields = {name: poisoned(getattr(value, name)) for name in value.__struct_fields__}
        return type(value)(**fields)
    if isinstance(value, list):
        return [poisoned(one) for one in value]
    if type(value) is str and value and value[0] not in "{[":
        return value + HOSTILE
    return (
        msgspec.msgpack.encode({HOSTILE: [HOSTILE]})
        if isinstance(value, bytes) and value
        else value
    )


def hostile_walk() -> list[Entry]:
    return [OPENED, *(poisoned(entry) for entry in walk()[1:])]


@pytest.fixture(scope="module")
def journal(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("hostile") / "walk.tcaj"
    path.write_bytes(encoded(hostile_walk()))
    return path


def is_harmless(text: str) -> bool:
    """Whether a text has printable characters only, and no line that the journal has added."""
    return all(line.isprintable() for line in text.split("\n")) and "\nALL IS WELL" not in text


@pytest.mark.parametrize("command", TO_STDOUT)
def test_hostile_text_never_controls_the_terminal(journal: Path, command: str) -> None:
    result = CliRunner().invoke(main, [*command.split(), str(journal)], prog_name="tca")
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    assert r"\x1b" in result.stdout or "\\u001b" in result.stdout
    assert is_harmless(result.stdout), [
        line for line in result.stdout.split("\n") if not line.isprintable()
    ][:3]
    assert is_harmless(result.stderr), result.stderr


class Tags(html.parser.HTMLParser):
    """A parser that collects tags and scripts that only a hostile text can have added."""

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
def test_hostile_text_stays_text_in_pages_and_pictures(
    journal: Path, tmp_path: Path, command: str, name: str
) -> None:
    out = tmp_path / name
    result = CliRunner().invoke(
        main, [*command.split(), str(journal), "-o", str(out)], prog_name="tca"
    )
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    assert is_harmless(result.stdout + result.stderr)
    assert out.exists()
    assert sorted(tmp_path.iterdir()) == [out]
    if name.endswith(".txt"):
        assert is_harmless(out.read_text())
    if name.endswith(".svg"):
        ET.fromstring(out.read_text())  # must be well formed
        assert "<img" not in out.read_text()
        assert "<script" not in out.read_text()
    if name.endswith(".html"):
        tags = Tags()
        tags.feed(out.read_text())
        assert not tags.found, tags.found[:3]
        assert "{{7*7}}" in out.read_text()


# --- failure names with colons --------------------------------------------------------------------


Tca = Callable[..., Result]
NAME = "knee: stuck: hard"
NAMED_IN_PRINT = [
    "log show",
    "log show --json",
    "log show --classic",
    "tree",
    "tree --story 2",
    "tree --story 1",
    "replay --text",
]
NAMED_IN_FILES = [
    "tree -o out.svg",
    "tree -o out.dot",
    "tree -o out.html",
    "report -o out.html",
    "export -o out.jsonl",
    "export -o out.pftrace",
    "gantt -o out.svg",
    "gantt -o out.html",
    "export --to csv -o out",
]


def failing_walk() -> Story:
    """Return a walk {1} whose move {2} fails with an unhandled failure."""
    story = Story().module("planner", "walk").module("legs", "move").at(1.0)
    walk = story.goal("walk", "user", to="planner", begins=True)
    move = story.command("move", "planner", walk, to="legs")
    story.at(2.0).returned(walk)
    story.at(3.0).failed(move, NAME, "the screw: it is loose")
    why = f"failure '{NAME}' of move {{2}} was not handled"
    story.say(facts.Unhandled(TaskId(move)), facts.Killed(TaskId(walk), why, "", 0, TaskId(move)))
    return story.reached(walk, *Moment).at(4.0).say(facts.Closed("interrupted"))


def assert_whole_name(text: str) -> None:
    halves = re.findall(r"knee.{0,20}", text)
    assert halves
    assert all(half.startswith(NAME) for half in halves), halves


@pytest.mark.parametrize("command", NAMED_IN_PRINT)
def test_printed_output_keeps_a_failure_name_with_colons(
    tca: Tca, tmp_path: Path, command: str
) -> None:
    name, *options = command.split()
    words = [name, options.pop(0)] if name == "log" else [name]
    result = tca(*words, failing_walk().write(tmp_path / "run"), *options)
    assert not result.exit_code, result.output
    assert_whole_name(result.stdout)


@pytest.mark.parametrize("command", NAMED_IN_FILES)
def test_written_files_keep_a_failure_name_with_colons(
    tca: Tca, tmp_path: Path, command: str
) -> None:
    name, *options, out = command.split()
    result = tca(name, failing_walk().write(tmp_path / "run"), *options, tmp_path / out)
    assert not result.exit_code, result.output
    files = (tmp_path / out).rglob("*") if (tmp_path / out).is_dir() else [tmp_path / out]
    assert_whole_name("\n".join(file.read_bytes().decode("utf-8", "replace") for file in files))


def test_page_keeps_a_failure_name_with_colons(tmp_path: Path) -> None:
    log = open_log(failing_walk().write(tmp_path / "run"))
    reading = Reading(log)
    for entry in log:
        reading.feed.apply(entry)
    for task in (1, 2):
        assert_whole_name(str(message_answer(reading, task, 4.0)))
    assert_whole_name(reading.feed.columns.frame({}, {}).decode("utf-8", "replace"))


def test_failure_name_with_colons_is_separate_from_its_text() -> None:
    run = failing_walk().fold()
    (kind,) = failures(run)
    assert (kind.failure, run.tasks[2].failure.name) == (NAME, NAME)
    (table,) = [one for one in TABLES if one.name == "failures"]
    (row,) = table.rows(run)
    assert dict(zip(table.columns, row, strict=True))["failure"] == NAME
    with io.BytesIO() as stream:
        write_mcap(run, failing_walk().entries, stream)
        messages = make_reader(io.BytesIO(stream.getvalue())).iter_messages()
        assert_whole_name("".join(message.data.decode() for _, _, message in messages))


# --- contradictory facts --------------------------------------------------------------------------


def test_fold_accepts_a_failure_caught_by_task_0() -> None:
    history = History()
    caught = facts.Caught(TaskId(1), TaskId(0), TaskId(0), 1)
    history.apply(facts.Entry(1, 1.0, [caught, facts.Recovered(TaskId(1))]))
    assert not history.tasks[TaskId(1)].is_recovering
