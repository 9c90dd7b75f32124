"""A failure may be called anything that can be printed, also with colons: all tools name the whole."""

import io
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result
from mcap.reader import make_reader
from tools.made_robots import fail
from tools.story import Story

from tca_tools.analysis.failures import failures
from tca_tools.export.mcap_file import write_mcap
from tca_tools.export.tables import TABLES
from tca_tools.journal.journals import open_log
from tca_tools.view.answers import message_answer
from tca_tools.view.reading import Reading
from tca_wire.journal import facts
from tca_wire.points import Moment, TaskId

Tca = Callable[..., Result]
NAME = "knee: stuck: hard"
TO_STDOUT = [
    "log show", "log show --json", "log show --classic", "tree", "tree --story 2", "tree --story 1", "replay --text",
]  # fmt: skip
TO_FILES = [
    "tree -o out.svg", "tree -o out.dot", "tree -o out.html", "report -o out.html", "export -o out.jsonl",
    "export -o out.pftrace", "gantt -o out.svg", "gantt -o out.html", "export --to csv -o out",
]  # fmt: skip


def broken() -> Story:
    """A walk {1} whose move {2} fails; nobody handles that."""
    story = Story().module("planner", "walk").module("legs", "move").at(1.0)
    walk = story.goal("walk", "user", to="planner", begins=True)
    move = story.command("move", "planner", walk, to="legs")
    story.at(2.0).returned(walk)
    fail(story.at(3.0), move, NAME, "the screw: it is loose")
    why = f"failure '{NAME}' of move {{2}} was not handled"
    story.say(facts.Unhandled(TaskId(move)), facts.Killed(TaskId(walk), why, "", 0, TaskId(move)))
    return story.reached(walk, *Moment).at(4.0).say(facts.Closed("interrupted"))


def assert_whole(text: str) -> None:
    halves = re.findall(r"knee.{0,20}", text)
    assert halves
    assert all(half.startswith(NAME) for half in halves), halves


@pytest.mark.parametrize("command", TO_STDOUT)
def test_what_is_printed_names_it(tca: Tca, tmp_path: Path, command: str) -> None:
    name, *options = command.split()
    words = [name, options.pop(0)] if name == "log" else [name]
    result = tca(*words, broken().write(tmp_path / "run"), *options)
    assert not result.exit_code, result.output
    assert_whole(result.stdout)


@pytest.mark.parametrize("command", TO_FILES)
def test_what_is_written_names_it(tca: Tca, tmp_path: Path, command: str) -> None:
    name, *options, out = command.split()
    result = tca(name, broken().write(tmp_path / "run"), *options, tmp_path / out)
    assert not result.exit_code, result.output
    files = (tmp_path / out).rglob("*") if (tmp_path / out).is_dir() else [tmp_path / out]
    assert_whole("\n".join(file.read_bytes().decode("utf-8", "replace") for file in files))


def test_the_page_names_it(tmp_path: Path) -> None:
    log = open_log(broken().write(tmp_path / "run"))
    reading = Reading(log)
    for entry in log:
        reading.feed.apply(entry)
    for task in (1, 2):
        assert_whole(str(message_answer(reading, task, 4.0)))
    assert_whole(reading.feed.columns.frame({}, {}).decode("utf-8", "replace"))


def test_data_have_the_name_alone() -> None:
    run = broken().fold()
    (kind,) = failures(run)
    assert (kind.failure, run.tasks[2].failure.name) == (NAME, NAME)
    (table,) = [one for one in TABLES if one.name == "failures"]
    (row,) = table.rows(run)
    assert dict(zip(table.columns, row, strict=True))["failure"] == NAME
    with io.BytesIO() as stream:
        write_mcap(run, broken().entries, stream)
        messages = make_reader(io.BytesIO(stream.getvalue())).iter_messages()
        assert_whole("".join(message.data.decode() for _, _, message in messages))
