"""A restart of central is marked in charts, reports and stories, and repeated tries in trees."""

import re
from pathlib import Path

from click.testing import CliRunner
from tools.story import Story

from tca_tools.explain.story import story
from tca_tools.gantt.build import chart
from tca_tools.gantt.cells import ASCII
from tca_tools.gantt.svg import svg_text
from tca_tools.gantt.text import chart_lines
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.fold import History
from tca_tools.journal.records import Restart
from tca_tools.report.__main__ import report
from tca_tools.tasktree_viz import words
from tca_wire.journal import facts
from tca_wire.points import TaskId
from tca_wire.text.measures import ordinal


def story_of_restarts() -> tuple[Story, int, int]:
    """Return a run with a planned and another restart, and a move before and one during them."""
    built = Story().module("legs", "move")
    early, long = built.command("move", "user"), built.command("move", "user")
    built.at(1.0).delivered(early, "legs").at(2.0).achieved(early)
    built.at(3.0).delivered(long, "legs")
    built.at(4.0).say(facts.CentralEnding("tca central", keep=True))
    built.at(4.5).say(facts.CentralRestarted(1.5, 2))
    built.at(5.0).say(facts.CentralRestarted(0.0, 2))
    built.at(6.0).achieved(long)
    return built, early, long


def restarted() -> tuple[History, int, int]:
    built, early, long = story_of_restarts()
    return built.fold(), early, long


def test_run_knows_its_restarts() -> None:
    history, *_ = restarted()
    assert history.restarts == [Restart(4.5, 1.5, True), Restart(5.0, 0.0, False)]


def test_story_has_the_restarts_during_a_task() -> None:
    history, early, long = restarted()
    marked = [one.time for one in story(history, long) if "central was restarted" in one.text]
    assert marked == [4.5, 5.0]
    assert not any("restarted" in one.text for one in story(history, early))


def test_chart_marks_restarts_in_its_window() -> None:
    history, *_ = restarted()
    for start, end, number in ((0.0, 7.0, 2), (0.0, 4.7, 1), (5.5, 7.0, 0)):
        drawing = chart(history, start, end)
        assert svg_text(drawing, "run").count('<rect class="restart" ') == number + bool(number)
        marks = [line for line in chart_lines(drawing, 100, ASCII) if line.startswith("central ")]
        assert [line.count("R") for line in marks] == [number] * bool(number)


def test_report_lists_restarts(tmp_path: Path) -> None:
    journal = story_of_restarts()[0].write(tmp_path / "run")
    made = CliRunner().invoke(report, [str(journal), "-o", str(tmp_path / "run.html")])
    assert made.exit_code == 0, made.output
    listed = re.findall(r"(\d\.\d+ s): central was restarted", (tmp_path / "run.html").read_text())
    assert listed == ["4.500 s", "5.000 s"]


def test_tree_names_the_attempt_at_each_time() -> None:
    built = Story().module("legs", "move")
    move = built.command("move", "user")
    for time in (1.0, 2.0):
        built.at(time).say(facts.Retried(TaskId(move), b"", "expert"))
    replaced = facts.Retried(TaskId(move), b"", "central", TaskId(move), fallback="call help")
    history = built.at(3.0).say(replaced).at(4.0).fold()
    labels = [words.called(RunAt(history, time).tasks[move]) for time in (0.5, 1.0, 2.5, 3.5)]
    assert labels == ["move {1}", *(f"move {{1}} ({tried} try)" for tried in ("2nd", "3rd", "3rd"))]


def test_ordinals_have_english_endings() -> None:
    found = [ordinal(number) for number in (1, 2, 3, 4, 11, 12, 13, 21, 112, 1003)]
    assert found == ["1st", "2nd", "3rd", "4th", "11th", "12th", "13th", "21st", "112th", "1,003rd"]
