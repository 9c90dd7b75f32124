"""A run that goes on though nothing happens is shown, and exported, until now; one that was closed is told as it was."""

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result
from mcap.reader import make_reader
from tools.story import QUERY, Story, silent_for, stuck, stumbling, walking
from tools.trace_reader import read_trace

from tca_wire.journal import facts
from tca_wire.points import TaskId

Tca = Callable[..., Result]
NOW = 44.0
"""The walk's last entry is at 4 s."""


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return walking().write(tmp_path / "run")


def table(folder: Path, name: str) -> list[dict[str, Any]]:
    with (folder / f"{name}.csv").open() as stream:
        return list(csv.DictReader(stream))


def test_a_trace_lasts_until_now(tca: Tca, run: Path, tmp_path: Path) -> None:
    with silent_for(run, NOW - 4.0):
        assert not tca("export", run, "-o", tmp_path / "live.pftrace").exit_code
    (here,) = read_trace(tmp_path / "live.pftrace").on("run")
    assert here.name == "still running"
    assert here.start >= NOW * 1e9
    assert here.details == {"last entry": 4.0}
    assert not tca("export", run, "-o", tmp_path / "over.pftrace").exit_code
    assert not read_trace(tmp_path / "over.pftrace").on("run")


def test_an_mcap_file_lasts_until_now(tca: Tca, run: Path, tmp_path: Path) -> None:
    with silent_for(run, NOW - 4.0):
        assert not tca("export", run, "-o", tmp_path / "run.mcap").exit_code
    with (tmp_path / "run.mcap").open("rb") as stream:
        reader = make_reader(stream)
        summary, (*_, (_, channel, last)) = reader.get_summary(), reader.iter_messages()
    assert channel.topic == "/tca/log"
    assert json.loads(last.data)["message"] == "still running: nothing has happened since 4.000 s"
    assert summary is not None
    assert summary.statistics is not None
    assert (summary.statistics.message_end_time - summary.statistics.message_start_time) / 1e9 >= NOW


def test_tables_say_until_when(tca: Tca, run: Path, tmp_path: Path) -> None:
    with silent_for(run, NOW - 4.0):
        assert not tca("export", run, "--to", "csv", "-o", tmp_path / "live").exit_code
    (live,) = table(tmp_path / "live", "run")
    assert (live["last"], live["live"]) == ("4.0", "true")
    assert float(live["until"]) >= NOW
    assert not tca("export", run, "--to", "csv", "-o", tmp_path / "over").exit_code
    (over,) = table(tmp_path / "over", "run")
    assert (over["last"], over["until"], over["live"]) == ("4.0", "4.0", "false")


@pytest.mark.parametrize("command", ["gantt", "tree"])
def test_files_say_so_too(tca: Tca, run: Path, tmp_path: Path, command: str) -> None:
    out = tmp_path / "run.txt"
    with silent_for(run, NOW - 4.0):
        assert not tca(command, run, "-o", out).exit_code
        title = out.read_text().splitlines()[0]
        assert "(still running)" in title
        assert tca(command, run, "--at", 1.0).stdout.count("still running") == 0
    assert float(title.partition(" s (still")[0].split()[-1]) >= NOW
    assert not tca(command, run, "-o", out).exit_code
    assert "still running" not in out.read_text()


def test_the_chart_of_a_run_in_which_nothing_is_done_any_more_ends_with_what_was_done(tca: Tca, tmp_path: Path) -> None:
    idle = Story().module("legs", "move").at(1.0)
    idle.acted(idle.command("move", "user"), "legs", 1.0)
    run = idle.write(tmp_path / "idle")
    with silent_for(run, 100.0):
        assert "0.98 to 2.02 s" in tca("gantt", run).stdout
    assert "0.98 to 2.00 s" in tca("gantt", run).stdout


def asking() -> Story:
    """The handler of a goal waits for a question that nobody handles."""
    story = Story().module("shop", "restock").at(1.0)
    goal = story.goal("restock", "user", to="shop")
    question = story.at(2.0).received("ask supplier", QUERY, "shop", origin=goal)
    return story.queued(question).say(facts.WaitBegan("shop", goal, TaskId(question), 0))


@pytest.mark.parametrize("tale", [asking, stuck, stumbling])
def test_what_is_told_is_the_same(tale: Callable[[], Story], tca: Tca, tmp_path: Path) -> None:
    logs = [
        tale().at(20.0).say(*ended).write(tmp_path / name / "run")
        for name, ended in (("open", ()), ("closed", [facts.Closed("interrupted")]))
    ]
    first = min(tale().fold().tasks)
    for command in (["tree"], ["tree", "--story", first], ["gantt"], ["stats"]):
        there, closed = (tca(*command[:1], log, *command[1:]) for log in logs)
        assert there.exit_code == closed.exit_code == 0, closed.stderr
        assert closed.stdout == there.stdout
    for log in logs:
        assert tca("export", log, "-o", log.parent / "tables", "--to", "csv").exit_code == 0
    names = {path.name for path in (tmp_path / "open" / "tables").iterdir()}
    assert "messages.csv" in names
    for name in names - {"facts.csv", "events.csv"}:
        assert (tmp_path / "closed" / "tables" / name).read_text() == (tmp_path / "open" / "tables" / name).read_text()


def test_why_it_stands_is_said(tca: Tca, tmp_path: Path) -> None:
    log = asking().at(80.0).say(facts.Closed("interrupted")).write(tmp_path / "run")
    assert "waits for the reply to ask supplier {2}, which no module handles, for 78 s" in tca("tree", log).stdout
