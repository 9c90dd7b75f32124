"""Trees of a part of a run, the story of one task, and outlines of wide trees."""

import re
import sys
from collections.abc import Callable
from itertools import combinations, product
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from click.testing import Result
from hypothesis import given
from hypothesis import strategies as st
from tools.runs import encoded, walk
from tools.story import THIS, Story, locking, stumbling, walking

from tca_tools.journal.at_time import RunAt
from tca_tools.journal.fold import History
from tca_tools.tasktree_viz.arrows import arrows
from tca_tools.tasktree_viz.dot import dot_source
from tca_tools.tasktree_viz.files import is_figure
from tca_tools.tasktree_viz.lanes import MOST_LANES, MOST_LEAVING, lines
from tca_tools.tasktree_viz.outline import Row, outline, whole_outline
from tca_tools.tasktree_viz.outline_svg import CHARACTER, outline_svg
from tca_tools.tasktree_viz.text import tree_lines
from tca_wire.constraints import Constraint, plan_ahead, sequential_achievement
from tca_wire.journal.facts import Entry
from tca_wire.points import TaskId

Tca = Callable[..., Result]
SVG = "{http://www.w3.org/2000/svg}"


def names(shown: str) -> list[str]:
    """Return the tasks of a text tree."""
    return re.findall(r"^[│├└─ ]*([^{\n]*\{\d+\})  ", shown, re.MULTILINE)


def wide(children: int = 12) -> Story:
    """Return a goal with pairs of commands in sequence."""
    story = Story()
    walk = story.goal("walk", "x", to="planner", begins=True)
    for _ in range(children):
        step = story.goal("step", "planner", walk)
        first = story.command("move leg", "planner", step)
        story.command("move body", "planner", step, sequential_achievement(TaskId(first), THIS))
    return story


def test_task_option_shows_only_the_subtree(tca: Tca, run: Path) -> None:
    shown = tca("tree", run, "--task", 2).stdout
    assert shown.splitlines()[0] == "run, task 2: 5.00 s, 3 tasks: 1 achieved, 1 failed, 1 killed"
    assert names(shown) == ["take steps {2}", "move leg {6}", "move body {7}"]
    assert names(tca("tree", run, "--task", "move leg").stdout) == ["move leg {6}", "move leg {9}"]


def test_module_option_shows_its_tasks_with_their_ancestors(tca: Tca, run: Path) -> None:
    shown = names(tca("tree", run, "--module", "controller").stdout)
    assert shown == ["traverse arc {1}", "take steps {2}", "move leg {6}", "move body {7}"]
    assert names(tca("tree", run, "--task", 2, "--module", "controller").stdout) == shown[1:]


def test_from_and_to_options_show_tasks_of_that_span(tca: Tca, run: Path) -> None:
    assert len(names(tca("tree", run, "--to", 1.3).stdout)) == 4  # sent by then
    shown = names(tca("tree", run, "--from", 3.5).stdout)
    assert "move leg {6}" not in shown  # achieved before
    assert "move body {7}" in shown
    assert tca("tree", run, "--from", 3, "--to", 2).exit_code == 2


def test_stories_match_their_transcripts(
    tca: Tca, run: Path, expect: Callable[[str, str], None]
) -> None:
    for number in (3, 7, 9):
        expect(f"tree_story_{number}", tca("tree", run, "--story", number, COLUMNS="90").stdout)


def test_story_option_accepts_the_number_of_a_query(tca: Tca, run: Path) -> None:
    result = tca("tree", run, "--story", 5)
    assert result.exit_code == 0, result.stderr
    first, _, sent, *_, handled = result.stdout.splitlines()
    assert first == "elevation map {5}: query"
    assert "query sent by gait planner while handling take steps {2}" in sent
    assert "handled by perception" in handled
    several = tca("tree", run, "--story", "elevation map").stderr
    assert several == "Error: 2 messages are called 'elevation map': name one by its number: 5, 8\n"


def test_story_can_be_a_file_and_of_a_past_time(tca: Tca, run: Path, tmp_path: Path) -> None:
    assert tca("tree", run, "--story", 7, "-o", tmp_path / "story.txt").exit_code == 0
    assert (
        (tmp_path / "story.txt")
        .read_text()
        .startswith("move body {7}: failed\nunder traverse arc {1} > ")
    )
    at = tca("tree", run, "--story", 7, "--at", 4.0).stdout
    assert at.startswith("move body {7}: handling\n")
    assert "terrain collision" not in at
    assert "must end in .txt" in tca("tree", run, "--story", 7, "-o", tmp_path / "story.svg").stderr


def test_deep_tree_keeps_its_guides(
    tca: Tca, tmp_path: Path, expect: Callable[[str, str], None]
) -> None:
    story, parent = Story(), 0
    for _ in range(24):
        parent = story.goal("take steps", "planner", parent)
        story.goal("look", "planner", parent)
    folder = story.write(tmp_path / "deep")
    expect("tree_deep", tca("tree", folder).stdout)
    lines = tca("tree", folder, COLUMNS="150").stdout.splitlines()
    assert not [line for line in lines if line.startswith("[")]


def test_small_tree_is_a_figure_and_wide_tree_an_outline() -> None:
    assert is_figure(whole_outline(RunAt(walking().fold())))
    assert not is_figure(outline(RunAt(wide().fold())))
    assert not is_figure(whole_outline(RunAt(wide(30).fold())))


@pytest.mark.parametrize("kind", ["svg", "png", "pdf", "html"])
@pytest.mark.parametrize("layout", ["figure", "outline"])
def test_tree_is_written_in_each_layout_and_format(
    tca: Tca, run: Path, tmp_path: Path, layout: str, kind: str
) -> None:
    if layout == "figure":
        pytest.importorskip("pygraphviz")
    result = tca("tree", run, "--layout", layout, "-o", tmp_path / f"tree.{kind}")
    assert (result.exit_code, result.stderr) == (0, "")
    beginnings = {"svg": b"<", "png": b"\x89PNG", "pdf": b"%PDF", "html": b"<!doctype html>"}
    assert (tmp_path / f"tree.{kind}").read_bytes().startswith(beginnings[kind])


def test_outline_has_a_row_per_task_and_sibling_arrows() -> None:
    at = RunAt(walking().fold())
    picture = ET.fromstring(outline_svg(at, whole_outline(at), "walking"))
    boxes = {
        text.text: (float(text.get("x", 0)), float(text.get("y", 0)))
        for text in picture.iter(f"{SVG}text")
        if text.get("class") == "name" and "{" in (text.text or "")
    }
    assert len(boxes) == len(at.tasks)
    assert sorted(boxes.values(), key=lambda place: place[1]) == list(
        boxes.values()
    )  # from top to bottom, in order
    assert boxes["take steps {2}"][0] == boxes["take steps {3}"][0] < boxes["move leg {6}"][0]
    heavy = [path for path in picture.iter(f"{SVG}path") if path.get("class") == "heavy"]
    assert len(heavy) == 4
    words = [text.text or "" for text in picture.iter(f"{SVG}text")]
    assert "plan ahead: after take steps {3}" in words
    assert any(word.startswith("held, waits until") for word in words)


def test_outline_of_a_deep_tree_stays_narrow() -> None:
    story, parent = Story(), 0
    for _ in range(1_000):
        parent = story.goal("take steps", "planner", parent)
    at = RunAt(story.fold())
    picture = ET.fromstring(outline_svg(at, whole_outline(at), "deep"))
    assert float(picture.get("width", 0)) < 1_600


def test_outline_legend_stays_within_the_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "tca_tools.tasktree_viz.outline_svg._TIMES", 15.0
    )  # a narrow picture with a long legend
    at = RunAt(History.until(walk()), 37.0)
    picture = ET.fromstring(outline_svg(at, whole_outline(at), "walk"))
    width = float(picture.get("width", 0))
    legend = [text for text in picture.iter(f"{SVG}text") if text.get("class") == "meaning"]
    assert "sent by a wiretap" in [text.text for text in legend]
    assert all(
        float(text.get("x", 0)) + len(text.text or "") * CHARACTER <= width for text in legend
    )
    assert len({text.get("y") for text in legend}) > 1


@pytest.mark.parametrize("story", [locking(), wide(), Story(), stumbling()])
def test_outline_is_well_formed_xml(story: Story) -> None:
    at = RunAt(story.fold())
    ET.fromstring(outline_svg(at, outline(at), "<&>\x1b", with_data=True))


def test_tree_without_graphviz_is_drawn_as_an_outline(
    tca: Tca, run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("shutil.which", lambda _: None)
    monkeypatch.setitem(sys.modules, "pygraphviz", None)
    result = tca("tree", run, "-o", tmp_path / "tree.svg")
    assert result.exit_code == 0
    assert result.stderr == (
        "this picture needs the Python package 'pygraphviz': pip install 'tca-central[pictures]', or install Graphviz: drawn as an outline\n"
    )
    assert (tmp_path / "tree.svg").read_text().startswith("<svg")
    assert tca("tree", run, "--layout", "figure", "-o", tmp_path / "figure.svg").exit_code == 1
    assert not (tmp_path / "figure.svg").exists()


@pytest.mark.parametrize(
    ("reads", "code", "error"), [("digraph", 0, ""), ("no such text", 1, "dot failed: bad")]
)
def test_dot_program_draws_the_figure_or_its_error_is_shown(
    tca: Tca,
    run: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    reads: str,
    code: int,
    error: str,
) -> None:
    program = tmp_path / "dot"
    program.write_text(
        f"#!/bin/sh\nif grep -q '{reads}'; then echo '<svg/>'; else echo bad >&2; exit 1; fi\n"
    )
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    result = tca("tree", run, "--layout", "figure", "-o", tmp_path / "tree.svg")
    assert (result.exit_code, error in result.stderr) == (code, True)
    assert code or (tmp_path / "tree.svg").read_bytes() == b"<svg/>\n<!-- made by tca -->\n"


def test_picture_of_too_many_tasks_is_refused(tca: Tca, tmp_path: Path) -> None:
    story, parent = Story(), 0
    for _ in range(3_100):
        parent = story.goal("take steps", "planner", parent)
    result = tca("tree", story.write(tmp_path / "run"), "--all", "-o", tmp_path / "tree.png")
    assert result.exit_code == 1
    assert "3100 tasks are too many for a picture: choose a part with --task" in result.stderr


def with_coarse_clock() -> list[Entry]:
    """Return the walk with a clock of 5 s steps, so that several events have one time."""
    return [Entry(entry.number, entry.time // 5, entry.facts) for entry in walk()]


@pytest.mark.parametrize("entries", [walk(), with_coarse_clock()])
def test_past_instant_looks_the_same_with_and_without_the_future(entries: list[Entry]) -> None:
    whole = History.until(entries)
    for instant in sorted({entry.time for entry in entries}):
        known, remembered = History.until(entries, instant), RunAt.by_clock(whole, instant)
        read = RunAt.by_clock(known, instant)
        assert (read.instant, read.time) == (remembered.instant, remembered.time)
        shown, expected = (
            list(tree_lines(at, whole_outline(at), with_data=True)) for at in (read, remembered)
        )
        assert shown == expected


def test_damage_after_the_requested_time_is_not_reported(tca: Tca, tmp_path: Path) -> None:
    entries = walk()
    late = tmp_path / "late.tcaj"
    late.write_bytes(encoded(entries) + b"\xce and then garbage")
    assert tca("tree", late).exit_code == 1
    early = tca("tree", late, "--at", entries[-2].time)
    assert (early.exit_code, early.stderr) == (0, "")


def test_later_task_or_module_is_unknown_at_an_earlier_time(tca: Tca, run: Path) -> None:
    for command in ("tree", "gantt"):
        refused = tca(command, run, "--at", 1.0, "--task", "move leg").stderr
        assert refused == "Error: no task 'move leg' in this journal until 1 s\n"
        refused = tca(command, run, "--at", 0.15, "--module", "controller").stderr
        assert refused == "Error: no module 'controller' in this journal until 0.15 s\n"


# --- heavy lines of an outline: waits between siblings --------------------------------------------


def after(*tasks: int) -> list[Constraint]:
    return [sequential_achievement(TaskId(task), THIS) for task in tasks]


def siblings(*waits_for: tuple[int, ...]) -> Story:
    """Return a story of a goal {1} with one task for each argument. The argument has the numbers of
    the tasks for which this task waits.
    """
    story = Story()
    goal = story.goal("assemble", "user")
    for tasks in waits_for:
        story.command("work", "user", goal, *after(*tasks))
    return story


class Picture:
    """The words and heavy lines of an outline."""

    def __init__(self, at: RunAt, rows: list[Row]) -> None:
        self.svg = ET.fromstring(outline_svg(at, rows, "picture"))
        self.words = [text.text or "" for text in self.svg.iter(f"{SVG}text")]
        boxes = {
            float(text.get("y", 0)): int(found[1])
            for text in self.svg.iter(f"{SVG}text")
            if text.get("class") == "name" and (found := re.search(r"\{(\d+)\}", text.text or ""))
        }
        self.pairs: list[tuple[int, int]] = []
        self.strokes: list[float] = []
        for line in self.svg.iter(f"{SVG}path"):
            if line.get("class") != "heavy":
                continue
            path = line.get("d", "")
            begins = [float(y) for y in re.findall(r"M\S+ (\S+) H", path)]
            comes = [float(y) for y in re.findall(r"Q\S+ \S+ \S+ (\S+) H", path)]
            below = [boxes[min(boxes, key=lambda name: abs(name - 4.0 - y))] for y in comes]
            above = [boxes[min(boxes, key=lambda name: abs(name - 4.0 - y))] for y in begins]
            self.pairs += product(above, below)
            self.strokes += [float(x) for x in re.findall(r"M(\S+) \S+ V", path)]


def drawn(story: Story) -> Picture:
    at = RunAt(story.fold())
    return Picture(at, whole_outline(at))


def test_each_wait_has_its_own_line() -> None:
    """Tasks wait for one paint, the other, or both. With one line for all, every task seemed to
    wait for both.
    """
    picture = drawn(siblings((), (), (2,), (3,), (2, 3)))
    assert sorted(picture.pairs) == [(2, 4), (2, 6), (3, 5), (3, 6)]
    assert len(set(picture.strokes)) == 3


def test_predecessors_of_the_same_tasks_share_one_line() -> None:
    picture = drawn(siblings((), (), (), (), (2, 3, 4, 5), (2, 3, 4, 5), (7,)))
    assert set(picture.pairs) == {*product([2, 3, 4, 5], [6, 7]), (7, 8)}
    assert len(picture.strokes) == 2
    assert any("a line from several tasks" in words for words in picture.words)


def test_waits_without_room_for_a_line_are_words() -> None:
    """Nine tasks wait for nine others. Nine lines are too many to follow."""
    picture = drawn(siblings(*([()] * 9), *((task,) for task in range(2, 11))))
    notes = {words for words in picture.words if words.startswith("after ")}
    assert len(picture.pairs) == MOST_LANES
    assert len(notes) == 9 - MOST_LANES
    assert {
        f"after work {{{task}}}" for task in range(2, 11) if (task, task + 9) not in picture.pairs
    } == notes


def test_folded_predecessors_are_named_in_words() -> None:
    """A folded task has no box where a line could begin."""
    at = RunAt(siblings(*([()] * 40), tuple(range(2, 42))).fold())
    rows = outline(at)
    shown = {int(row.task.id) for row in rows if row.task}
    picture = Picture(at, rows)
    assert {one for one, _ in picture.pairs} == shown - {1, 42}
    assert (
        f"after work {{4}}, work {{5}}, work {{6}} and {40 - len(picture.pairs) - 3} more"
        in picture.words
    )
    assert "after work {2}, work {3}, work" in dot_source(at, rows, "")


def test_folded_sequence_continues_in_words() -> None:
    at = RunAt(siblings((), *((task,) for task in range(2, 41))).fold())
    notes = [words for words in Picture(at, outline(at)).words if words.startswith("after ")]
    assert notes == ["after work {39}"]


def test_wait_implied_by_another_arrow_is_not_noted() -> None:
    """A check waits for a body move and for the hidden leg move before it, as after a kill."""
    at = RunAt(siblings((), (2,), (2, 3)).fold())
    assert arrows(at, {1, 3, 4}).unseen == {(2, 3): ["SEQ"]}


def test_plan_ahead_constraint_is_words_not_a_line() -> None:
    story = siblings(())
    story.goal("take steps", "user", 1, plan_ahead(TaskId(2), THIS))
    picture = drawn(story)
    assert picture.pairs == []
    assert "plan ahead: after work {2}" in picture.words


def test_deep_siblings_have_words_instead_of_lines() -> None:
    story, parent = Story(), 0
    for _ in range(60):
        parent = story.goal("take steps", "user", parent)
    first = story.command("move", "user", parent)
    story.command("move", "user", parent, *after(first))
    picture = drawn(story)
    assert picture.pairs == []
    assert f"after move {{{first}}}" in picture.words


@given(
    st.sets(
        st.tuples(st.integers(0, 12), st.integers(0, 12)).filter(lambda pair: pair[0] < pair[1])
    )
)
def test_lines_draw_only_given_pairs_without_overlap(pairs: set[tuple[int, int]]) -> None:
    found = lines(pairs)
    drawn_pairs = [pair for line in found for pair in product(line.sources, line.targets)]
    assert len(drawn_pairs) == len(set(drawn_pairs))
    assert set(drawn_pairs) <= pairs
    for line in found:
        assert max(line.sources) < min(line.targets)
    for one, other in combinations(found, 2):
        apart = one.ends[1] <= other.ends[0] or other.ends[1] <= one.ends[0]
        assert one.lane != other.lane or apart
    for row in range(12):
        assert sum(row in line.sources for line in found) <= MOST_LEAVING
    if len(pairs) <= MOST_LEAVING:
        assert set(drawn_pairs) == pairs
