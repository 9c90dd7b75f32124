"""The heavy lines of an outline, read as a person would: each says who waits for whom, and nothing else."""

import re
from itertools import combinations, product
from xml.etree import ElementTree as ET

from hypothesis import given
from hypothesis import strategies as st
from tools.story import THIS, Story

from tca_tools.run.at_time import RunAt
from tca_tools.tasktree_viz.arrows import arrows
from tca_tools.tasktree_viz.dot import dot_source
from tca_tools.tasktree_viz.lanes import MOST_LANES, MOST_LEAVING, lines
from tca_tools.tasktree_viz.outline import Row, outline, whole_outline
from tca_tools.tasktree_viz.outline_svg import outline_svg
from tca_tools.tasktree_viz.words import lines_of
from tca_wire.constraints import Constraint, plan_ahead, sequential_achievement
from tca_wire.points import TaskId

SVG = "{http://www.w3.org/2000/svg}"


def after(*tasks: int) -> list[Constraint]:
    return [sequential_achievement(TaskId(task), THIS) for task in tasks]


def brothers(*waits_for: tuple[int, ...]) -> Story:
    """A goal {1} with a task for each of these, which waits for the tasks of these numbers."""
    story = Story()
    goal = story.goal("assemble", "user")
    for tasks in waits_for:
        story.command("work", "user", goal, *after(*tasks))
    return story


class Picture:
    """What is to be seen."""

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


def test_each_wait_has_a_line_of_its_own() -> None:
    """Who waits for one paint, who for the other and who for both: it looked as if all waited for both."""
    picture = drawn(brothers((), (), (2,), (3,), (2, 3)))
    assert sorted(picture.pairs) == [(2, 4), (2, 6), (3, 5), (3, 6)]
    assert len(set(picture.strokes)) == 3


def test_lines_of_all_that_are_waited_for_by_the_same_are_one() -> None:
    picture = drawn(brothers((), (), (), (), (2, 3, 4, 5), (2, 3, 4, 5), (7,)))
    assert set(picture.pairs) == {*product([2, 3, 4, 5], [6, 7]), (7, 8)}
    assert len(picture.strokes) == 2
    assert any("one that begins at several tasks" in words for words in picture.words)


def test_what_has_no_room_is_said_in_words() -> None:
    """Nine things, each after one of nine others: nobody could follow so many lines."""
    picture = drawn(brothers(*([()] * 9), *((task,) for task in range(2, 11))))
    said = {words for words in picture.words if words.startswith("after ")}
    assert len(picture.pairs) == MOST_LANES
    assert len(said) == 9 - MOST_LANES
    assert {f"after work {{{task}}}" for task in range(2, 11) if (task, task + 9) not in picture.pairs} == said


def test_a_line_from_some_says_in_words_who_else_is_waited_for() -> None:
    """Tasks that are folded up have no box from which a line could lead."""
    at = RunAt(brothers(*([()] * 40), tuple(range(2, 42))).fold())
    rows = outline(at)
    shown = {int(row.task.id) for row in rows if row.task}
    picture = Picture(at, rows)
    assert {one for one, _ in picture.pairs} == shown - {1, 42}
    assert f"after work {{4}}, work {{5}}, work {{6}} and {40 - len(picture.pairs) - 3} more" in picture.words
    assert "after work {2}, work {3}, work" in dot_source(at, rows, "")


def test_a_sequence_that_is_folded_up_goes_on_in_words() -> None:
    at = RunAt(brothers((), *((task,) for task in range(2, 41))).fold())
    said = [words for words in Picture(at, outline(at)).words if words.startswith("after ")]
    assert said == ["after work {39}"]


def test_what_follows_from_a_line_is_not_said_of_who_is_not_shown() -> None:
    """A check waits for a body move and, as after a kill, for the leg move before that, which is not shown."""
    at = RunAt(brothers((), (2,), (2, 3)).fold())
    assert arrows(at, {1, 3, 4}).unseen == {(2, 3): ["SEQ"]}


def test_only_what_is_achieved_one_after_the_other_has_a_line() -> None:
    story = brothers(())
    story.goal("take steps", "user", 1, plan_ahead(TaskId(2), THIS))
    picture = drawn(story)
    assert picture.pairs == []
    assert "plan ahead: after work {2}" in picture.words


def test_deep_down_lines_would_run_into_each_other() -> None:
    story, parent = Story(), 0
    for _ in range(60):
        parent = story.goal("take steps", "user", parent)
    first = story.command("move", "user", parent)
    story.command("move", "user", parent, *after(first))
    picture = drawn(story)
    assert picture.pairs == []
    assert f"after move {{{first}}}" in picture.words


@given(st.sets(st.tuples(st.integers(0, 12), st.integers(0, 12)).filter(lambda pair: pair[0] < pair[1])))
def test_lines_say_nothing_that_is_not_so(pairs: set[tuple[int, int]]) -> None:
    found = lines(pairs)
    said = [pair for line in found for pair in product(line.sources, line.to)]
    assert len(said) == len(set(said))
    assert set(said) <= pairs
    for line in found:
        assert max(line.sources) < min(line.to)
    for one, other in combinations(found, 2):
        apart = one.ends[1] <= other.ends[0] or other.ends[1] <= one.ends[0]
        assert one.lane != other.lane or apart
    for row in range(12):
        assert sum(row in line.sources for line in found) <= MOST_LEAVING
    if len(pairs) <= MOST_LEAVING:
        assert set(said) == pairs


def test_in_a_picture_a_number_stays_with_its_unit() -> None:
    text = "held, waits until compile {17} is achieved, for 1.87 s; in the end for page admin {38}"
    found = [lines_of(text, columns, 9) for columns in range(20, 60)]
    assert all(" ".join(lines) == text for lines in found)
    assert not [line for lines in found for line in lines if line.endswith("1.87")]
