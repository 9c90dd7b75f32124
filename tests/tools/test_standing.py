"""How a task stands, in one word everywhere: of one that failed, also whether the run went on after that."""

from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result
from tools.made_robots import caught, fail
from tools.story import Story
from tools.test_coping import replacing

from tca_tools.analysis.summary import summary
from tca_tools.replay.growth import growth_lines
from tca_tools.replay.panes import colour_of
from tca_tools.replay.recording import Recording
from tca_tools.report.tree import tree
from tca_tools.run.at_time import RunAt
from tca_tools.run.fates import HANDLED
from tca_tools.tasktree_viz.dot import FILLS, dot_source
from tca_tools.tasktree_viz.outline import whole_outline
from tca_tools.tasktree_viz.outline_svg import outline_svg
from tca_tools.tasktree_viz.text import tree_lines
from tca_tools.tasktree_viz.told import story_lines
from tca_tools.tasktree_viz.words import summary as title
from tca_wire.points import TaskId
from tca_wire.vocabulary import MessageClass

Tca = Callable[..., Result]
STEP = TaskId(2)
YELLOW, RED = "\x1b[33m", "\x1b[31m"


@pytest.mark.parametrize("top_fails", [False, True])
def test_what_failed_and_was_handled_is_amber_everywhere(*, top_fails: bool) -> None:
    told = replacing(top_fails=top_fails)
    run, word, colour = told.fold(), "failed" if top_fails else HANDLED, RED if top_fails else YELLOW
    at, rows = RunAt(run), whole_outline(RunAt(run))
    assert at.tasks[STEP].standing == word
    assert title(at).endswith(f"1 {word}" + ", 1 killed" * top_fails)
    assert summary(run).tasks[word] == 1
    assert [line for line in tree_lines(at, rows) if f"step {{2}}  {colour}{word}" in line]
    assert next(story_lines(run, STEP)) == f"step {{2}}: {colour}{word}\x1b[0m"
    grown = growth_lines(Recording(told.entries), 0.0, None)  # when it failed nobody knew what would become of that
    assert [line for line in grown if f"{RED}failed\x1b[0m, blind" in line]
    assert colour_of(word) == ("red" if top_fails else "yellow")
    for picture in (dot_source(at, rows, ""), outline_svg(at, rows, "")):
        assert FILLS[word] in picture
        assert word in picture
        assert FILLS["failed" if word == HANDLED else HANDLED] not in picture
    assert [node.task.standing for node in tree(run).nodes if node.task] == [
        "killed" if top_fails else "achieved",
        word,
    ]


def test_a_report_shows_it_too(tca: Tca, tmp_path: Path) -> None:
    out = tmp_path / "run.html"
    assert not tca("report", replacing().write(tmp_path / "walk"), "-o", out).exit_code
    assert '<span class="r-tag s-handled">1 failed (handled)</span>' in out.read_text()


def recovering() -> Story:
    """A move {1} slips at 2 s; recover {2} can't deal with that, and recover {3} is called at 3 s. It is 4.5 s."""
    told = Story().module("legs", "move").module("expert", "recover").at(1.0)
    move = told.command("move", "user", to="legs")
    told.at(2.0)
    fail(told, move, "slip", "on ice")
    caught(told, move)
    caught(told.at(3.0), move)
    return told.at(4.5)


def test_who_recovers_says_who_works_on_it_and_for_how_long(tca: Tca, tmp_path: Path) -> None:
    folder = recovering().write(tmp_path / "walk")
    line = tca("tree", folder).stdout.splitlines()[2]
    assert line.endswith("slip: on ice; waits until recover {3} has dealt with its failure, for 1.5 s")
    assert (
        tca("tree", folder, "--at", 2.5)
        .stdout.splitlines()[2]
        .endswith("slip: on ice; waits until recover {2} has dealt with its failure, for 500 ms")
    )
    at = RunAt(recovering().fold())
    assert "recovering, slip: on ice; waits until recover {3}" in outline_svg(at, whole_outline(at), "")


def test_a_journal_that_begins_in_the_midst_knows_of_nobody() -> None:
    told = recovering()
    for entry in told.entries:
        entry.facts[:] = [
            one for one in entry.facts if getattr(one, "message_class", None) is not MessageClass.EXCEPTION
        ]
    at = RunAt(told.fold())
    line = next(line for line in tree_lines(at, whole_outline(at)) if line.startswith("move {1}"))
    assert "slip: on ice; waits until somebody has dealt with its failure" in line


@pytest.mark.parametrize("width", [10, 40, 49, 79])
def test_on_a_narrow_terminal_the_tree_has_room(tca: Tca, tmp_path: Path, width: int) -> None:
    folder, columns = replacing().write(tmp_path / "walk"), {"COLUMNS": str(width)}
    lines = tca("tree", folder, **columns).stdout.splitlines()
    assert max(map(len, lines)) <= width
    assert lines[2].startswith("wal")
    if width >= 40:
        assert lines[3].startswith(f"└─ step {{2}}  {HANDLED}")
        assert ("achieving" in lines[1]) == (width >= 60)
    story = tca("tree", folder, "--story", 2, **columns).stdout.splitlines()
    assert max(map(len, story)) <= max(width, 20)


def test_deep_trees_keep_names_on_a_narrow_terminal(tca: Tca, tmp_path: Path) -> None:
    told, parent = Story().at(1.0), 0
    for _ in range(12):
        parent = told.goal("step", "user", parent)
    lines = tca("tree", told.write(tmp_path / "deep"), COLUMNS="40").stdout.splitlines()
    assert max(map(len, lines)) <= 40
    assert all("step {" in line for line in lines[2:])
