import tracemalloc
from itertools import pairwise
from typing import Any, get_args, get_type_hints

import click
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sampling import lives
from tools.story import PLANNING, Story, arcs, made, stumbling, walking

from tca_tools.explain import wait_words
from tca_tools.explain.story import story
from tca_tools.gantt.build import chart
from tca_tools.gantt.svg import svg_text
from tca_tools.gantt.text import chart_lines
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.fold import History
from tca_tools.journal.lives import life_at
from tca_tools.journal.records import Offer
from tca_tools.tasktree_viz.dot import dot_source
from tca_tools.tasktree_viz.outline import outline, whole_outline
from tca_tools.tasktree_viz.text import tree_lines
from tca_wire.journal import facts
from tca_wire.life_cycles import BASIC, GENERAL
from tca_wire.points import Moment, TaskId
from tca_wire.text.facts_in_words import Wording
from tca_wire.vocabulary import MessageClass, Outcome


def reasons(history: History, task: int) -> list[str]:
    return (
        wait_words.reasons(at := RunAt(history), at.tasks[TaskId(task)])
        if task in history.tasks
        else []
    )


def test_fold_builds_the_tree_and_handlings() -> None:
    history = walking().fold()
    assert history.top == [1]
    assert [*history.tasks[TaskId(1)].children] == [2, 3, 4]
    assert history.tasks[6].reached[Moment.END_ACHIEVING] == 3.4
    assert history.tasks[6].handlings[0].module == "controller"


def test_fold_keeps_offers_and_the_first_format() -> None:
    story = Story().module("one", "walk").module("two", "walk", resource="legs")
    first = facts.FormatDefined("walk", MessageClass.GOAL, '{"type":"number"}', "", "one")
    story.say(first, facts.FormatDefined("walk", MessageClass.GOAL, "{}", "", "two"))
    story.say(facts.HandlerRemoved("walk", "one"))
    history = story.fold()
    assert history.offers == {"walk": [Offer("one", "one", 0.0, 0.0), Offer("two", "legs", 0.0)]}
    assert history.formats == {"walk": first}


def test_lost_module_ends_its_handlings() -> None:
    story = Story().module("legs", "walk")
    goal = story.goal("walk", "x", to="legs")
    story.at(2.0).say(
        facts.Failed(goal, "module lost", "killed"), facts.ModuleLeft("legs", "killed")
    )
    history = story.at(5.0).fold()
    assert [(run.end, run.outcome) for run in history.handlings] == [(2.0, Outcome.FAILED)]
    assert RunAt(history).running("legs", "legs") == []
    assert history.modules["legs"].joined == [(0.0, 2.0)]
    assert history.modules["legs"].left == "killed"


def test_fold_accepts_a_journal_from_any_entry_on() -> None:
    whole = walking().entries
    for first in range(len(whole)):
        history = History.until(whole[first:])
        assert all(task.parent < task.id for task in history.tasks.values())
    history = History.until(whole[8:])
    assert str(history.tasks[2]) == "? {2}"
    assert history.top == [2, 3]  # earlier tasks are unknown: their children are under the root


def ask_everything(history: History) -> None:
    """Ask a history everything that the tools ask. No question may raise."""
    for task in history.tasks.values():
        reasons(history, task.id)
        life_at(history, task)
        assert story(history, task.id)
    for rows in (whole_outline(RunAt(history)), outline(RunAt(history), shown_at_most=2)):
        list(tree_lines(RunAt(history), rows, width=60, with_data=True))
        dot_source(RunAt(history), rows, "title", with_data=True)
    drawing = chart(history)
    svg_text(drawing, "title")
    list(chart_lines(drawing, 60))


@pytest.mark.parametrize("story", [walking(), stumbling(), arcs()])
def test_every_prefix_of_a_journal_can_be_shown(story: Story) -> None:
    for length in range(len(story.entries) + 1):
        ask_everything(History.until(story.entries[:length]))


IDS = st.integers(-2, 9)
NAMES = st.sampled_from(["a", "b", "<&\x1b", ""])


def random_fact(kind: Any) -> st.SearchStrategy[facts.Fact]:
    numbers = [name for name, what in get_type_hints(kind).items() if what in (int, TaskId)]
    fields: dict[str, Any] = dict.fromkeys(numbers, IDS | st.integers(-(1 << 63), (1 << 64) - 1))
    fields |= dict.fromkeys(("id", "message_id", "task", "parent", "origin"), IDS)
    fields |= dict.fromkeys(("message", "module", "resource"), NAMES)
    fields |= {"moments": st.integers(0, 63), "moment": st.sampled_from(list(map(int, Moment)))}
    fields["body"] = st.binary(max_size=4)
    fields["transition"] = st.sampled_from([one.name for one in GENERAL.transitions])
    fields["life_cycle"] = st.sampled_from(["", "[]", BASIC.text])
    return st.builds(
        kind, **{name: some for name, some in fields.items() if name in kind.__struct_fields__}
    )


FACTS = st.one_of([random_fact(kind) for kind in get_args(facts.Fact)])


@given(st.lists(FACTS, max_size=80))
@settings(max_examples=lives(20, soak=500))
def test_arbitrary_facts_can_be_folded_and_shown(arbitrary: list[facts.Fact]) -> None:
    wording = Wording()
    history = History.until(
        facts.Entry(number, number // 3, [fact]) for number, fact in enumerate(arbitrary)
    )
    ask_everything(history)
    assert all(isinstance(wording.words(fact), str) for fact in arbitrary)
    assert all(task.parent < task.id for task in history.tasks.values())


def test_impossible_parent_becomes_the_root() -> None:
    story = Story()
    for parent in (1, 7, -3):
        story.goal("walk", "x", parent)
    history = story.fold()
    assert [task.parent for task in history.tasks.values()] == [0, 0, 0]
    assert history.top == [1, 2, 3]


def test_tree_of_depth_2000_is_drawn() -> None:
    story, parent = Story(), 0
    for _ in range(2_000):
        parent = story.goal("take steps", "planner", parent)
        story.reached(parent, PLANNING)
    history = story.fold()
    rows = whole_outline(RunAt(history))
    assert rows[-1].depth == 1_999
    lines = [click.unstyle(line) for line in tree_lines(RunAt(history), rows, width=None)]
    assert all(len(line) < 220 for line in lines)
    assert "└─ take steps {1987}" in lines[-14]
    assert "take steps {2000}" in lines[-1]
    assert dot_source(RunAt(history), rows, "deep").count(" -> ") == 1_999


@given(st.lists(st.floats(0, 3), min_size=6, max_size=6))
def test_handlings_of_a_slot_never_overlap_for_any_times(times: list[float]) -> None:
    story = made("told_late")
    last_facts = story.entries[-1].facts
    last_facts.clear()
    for number in (1, 2, 3):
        if number > 1:
            last_facts.append(facts.Delivered(number, number, "ear", "ear", 1, began=times[number]))
        last_facts.append(facts.Returned(number, Outcome.DONE, b"", times[number + 2]))
    runs = story.fold().handlings
    assert all(before.until <= after.start for before, after in pairwise(runs))
    assert all(run.start <= run.until <= 2.0 for run in runs)


def test_achieved_task_takes_less_than_1500_bytes() -> None:
    """A run may have millions of achieved tasks."""
    many, story = 500, Story().module("legs", "move")
    for number in range(many):
        move = story.at(float(number)).command("move", "user")
        story.queued(move, "legs").delivered(move, "legs").reached(move, *Moment).returned(move)
    tracemalloc.start()
    history = History.until(story.entries)
    size, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(history.tasks) == many
    assert size / many < 1500  # bytes; lists for all optional parts would double it
