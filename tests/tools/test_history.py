import tracemalloc
from itertools import pairwise
from typing import Any, get_args, get_type_hints

import click
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tools.story import PLANNING, THIS, Story, arcs, stumbling, walking

from tca_tools.explain import wait_words
from tca_tools.explain.story import story
from tca_tools.gantt.build import chart
from tca_tools.gantt.svg import svg_text
from tca_tools.gantt.text import chart_lines
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.fold import History
from tca_tools.journal.lives import life_of
from tca_tools.journal.records import HandlerWait, Offer, TaskState
from tca_tools.tasktree_viz.dot import dot_source
from tca_tools.tasktree_viz.outline import outline, whole_outline
from tca_tools.tasktree_viz.text import tree_lines
from tca_wire.constraints import sequential_achievement
from tca_wire.journal import facts
from tca_wire.life_cycles import BASIC, GENERAL
from tca_wire.points import Moment, TaskId
from tca_wire.text.facts_in_words import Wording
from tca_wire.vocabulary import MessageClass, Outcome


def reasons(history: History, task: int) -> list[str]:
    return wait_words.reasons(at := RunAt(history), at.tasks[TaskId(task)]) if task in history.tasks else []


def test_the_tree_and_its_handlers() -> None:
    history = walking().fold()
    assert history.top == [1]
    assert [*history.children(1)] == [2, 3, 4]
    assert history.tasks[6].reached[Moment.END_ACHIEVING] == 3.4
    assert history.tasks[6].handlings[0].module == "controller"


def test_why_a_queued_or_blocked_task_waits() -> None:
    assert reasons(walking().fold(until=0.65), 2) == ["for gait planner, busy with traverse arc {1}"]
    assert reasons(walking().fold(until=1.0), 2) == ["for the reply to elevation map {5}, which perception handles"]
    story = Story()
    story.queued(story.goal("dance", "user interface"))
    assert reasons(story.fold(), 1) == ["for a module that handles dance"]


def test_a_handler_that_waits_for_a_task() -> None:
    story = Story()
    first, second = story.goal("a", "x"), story.goal("b", "x")
    story.delivered(second, "m").reached(second, Moment.START_ACHIEVING)
    story.say(facts.WaitBegan("m", second, TaskId(first), Moment.END_PLANNING))
    assert reasons(story.fold(), second) == ["until a {1} is planned"]
    story.at(3.0).say(facts.WaitEnded("m", second, TaskId(first)))
    history = story.fold()
    assert [*history.handlings[0].waits] == [HandlerWait(1, 0.0, Moment.END_PLANNING, 3.0)]
    assert reasons(history, second) == []


def test_two_threads_of_a_module_wait_for_the_same_task() -> None:
    story = Story().module("script")
    task = TaskId(story.goal("walk", "script"))
    for time in (1.0, 2.0):
        story.at(time).say(facts.WaitBegan("script", 0, task, Moment.END_ACHIEVING))
    for time in (3.0, 4.0):
        story.at(time).say(facts.WaitEnded("script", 0, task))
    assert [wait.end for wait in story.fold().modules["script"].waits] == [4.0, 3.0]


def test_a_failed_task_that_is_handled_anew_is_no_failure() -> None:
    story = Story()
    goal = story.goal("walk", "x", to="m")
    story.failed(goal, "slip", "")
    assert story.fold().tasks[goal].state is TaskState.FAILED
    story.delivered(goal, "m")
    assert story.fold().tasks[goal].state is TaskState.PLANNING


def test_who_handles_what_in_which_format() -> None:
    story = Story().module("one", "walk").module("two", "walk", resource="legs")
    first = facts.FormatDefined("walk", MessageClass.GOAL, '{"type":"number"}', "", "one")
    story.say(first, facts.FormatDefined("walk", MessageClass.GOAL, "{}", "", "two"))
    story.say(facts.HandlerRemoved("walk", "one"))
    history = story.fold()
    assert history.offers == {"walk": [Offer("one", "one", 0.0, 0.0), Offer("two", "legs", 0.0)]}
    assert history.formats == {"walk": first}


def test_a_module_that_is_lost_handles_nothing_any_more() -> None:
    story = Story().module("legs", "walk")
    goal = story.goal("walk", "x", to="legs")
    story.at(2.0).say(facts.Failed(goal, "module lost", "killed"), facts.ModuleLeft("legs", "killed"))
    history = story.at(5.0).fold()
    assert [(run.end, run.outcome) for run in history.handlings] == [(2.0, Outcome.FAILED)]
    assert RunAt(history).running("legs", "legs") == []
    assert history.modules["legs"].joined == [(0.0, 2.0)]
    assert history.modules["legs"].left == "killed"


def test_a_broadcast_has_a_handling_for_each_receiver() -> None:
    story = Story()
    pose = story.received("pose", MessageClass.BROADCAST, "legs")
    for delivery, module in ((2, "map"), (3, "screen")):
        story.say(facts.Queued(delivery, pose, module, module), facts.Delivered(delivery, pose, module, module))
    story.at(1.0).say(facts.Returned(2, Outcome.DONE, b""))
    history = story.fold()
    assert [(run.name, run.module, run.end) for run in history.messages[pose].handlings] == [
        ("pose", "map", 1.0),
        ("pose", "screen", None),
    ]
    assert [queue.message_id for queue in history.queueings] == [pose, pose]


def test_a_journal_may_begin_in_the_middle() -> None:
    whole = walking().entries
    for first in range(len(whole)):
        history = History.until(whole[first:])
        assert all(task.parent < task.id for task in history.tasks.values())
    history = History.until(whole[8:])
    assert str(history.tasks[2]) == "? {2}"
    assert history.top == [2, 3]  # what was sent before hangs under the root


def everything_about(history: History) -> None:
    """Ask a history all that the tools ask; nothing may fail."""
    for task in history.tasks.values():
        reasons(history, task.id)
        list(life_of(history, task))
        assert story(history, task.id)
    for rows in (whole_outline(RunAt(history)), outline(RunAt(history), shown_at_most=2)):
        list(tree_lines(RunAt(history), rows, width=60, with_data=True))
        dot_source(RunAt(history), rows, "title", with_data=True)
    drawing = chart(history)
    svg_text(drawing, "title")
    list(chart_lines(drawing, 60))


@pytest.mark.parametrize("story", [walking(), stumbling(), arcs()])
def test_every_prefix_folds_and_shows(story: Story) -> None:
    for length in range(len(story.entries) + 1):
        everything_about(History.until(story.entries[:length]))


IDS = st.integers(-2, 9)
NAMES = st.sampled_from(["a", "b", "<&\x1b", ""])


def a_fact(kind: Any) -> st.SearchStrategy[facts.Fact]:
    numbers = [name for name, what in get_type_hints(kind).items() if what in (int, TaskId)]
    fields: dict[str, Any] = dict.fromkeys(numbers, IDS | st.integers(-(1 << 63), (1 << 64) - 1))
    fields |= dict.fromkeys(("id", "message_id", "task", "parent", "origin"), IDS)
    fields |= dict.fromkeys(("message", "module", "resource"), NAMES)
    fields |= {"moments": st.integers(0, 63), "moment": st.sampled_from(list(map(int, Moment)))}
    fields["body"] = st.binary(max_size=4)
    fields["transition"] = st.sampled_from([one.name for one in GENERAL.transitions])
    fields["life_cycle"] = st.sampled_from(["", "[]", BASIC.text])
    return st.builds(kind, **{name: some for name, some in fields.items() if name in kind.__struct_fields__})


FACTS = st.one_of([a_fact(kind) for kind in get_args(facts.Fact)])


@given(st.lists(FACTS, max_size=80))
@settings(max_examples=80)
def test_any_facts_at_all_fold_and_show(told: list[facts.Fact]) -> None:
    wording = Wording()
    history = History.until(facts.Entry(number, number // 3, [fact]) for number, fact in enumerate(told))
    everything_about(history)
    assert all(isinstance(wording.words(fact), str) for fact in told)
    assert all(task.parent < task.id for task in history.tasks.values())


def test_a_parent_that_cant_be_is_none() -> None:
    story = Story()
    for parent in (1, 7, -3):
        story.goal("walk", "x", parent)
    history = story.fold()
    assert [task.parent for task in history.tasks.values()] == [0, 0, 0]
    assert history.top == [1, 2, 3]


def test_a_tree_may_be_as_deep_as_it_likes() -> None:
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


def test_a_copy_whose_listener_left_is_handled_no_longer() -> None:
    story = Story().module("map", "pose")
    pose = story.received("pose", MessageClass.BROADCAST, "legs")
    story.say(facts.Delivered(9, pose, "map", "map")).at(1.0).say(facts.Dropped(9, "any", "it left"))
    history = story.fold()
    assert RunAt(history).running("map", "map") == []
    assert [handling.end for handling in history.messages[pose].handlings] == [1.0]


def test_a_message_waits_for_a_locked_resource_and_a_handler_for_its_lock() -> None:
    story = Story().module("legs", "move").module("planner", "walk")
    move, walk = story.command("move", "user"), story.goal("walk", "user")
    story.delivered(walk, "planner").delivered(move, "legs")
    story.at(1.0).say(facts.Claimed(20, "legs", "legs", False, "planner", walk))
    assert reasons(story.fold(), walk) == ["for the lock of legs {20}, busy with move {1}"]
    story.returned(move).say(facts.Granted(20))
    other = story.command("move", "eyes")
    story.queued(other, "legs")
    assert reasons(story.fold(), walk) == []
    assert reasons(story.fold(), other) == ["for legs, which planner has locked while handling walk {2}"]
    assert reasons(story.at(1.5).returned(walk).fold(), other) == ["for legs, which planner has locked for walk {2}"]
    story.at(2.0).say(facts.ClaimEnded(20, "released"), facts.Claimed(21, "legs", "legs", True, "eyes", 0))
    story.say(facts.Granted(21)).delivered(move, "legs")
    assert reasons(story.fold(), other) == ["for legs, busy with move {1}"]
    claim = story.fold().claims[20]
    assert (claim.start, claim.granted, claim.end, claim.ended) == (1.0, 1.0, 2.0, "released")


def test_direct_messages_are_counted_and_shown_though_central_never_saw_them() -> None:
    story = Story().module("map", "height").at(2.0)
    story.say(facts.HandledDirectly("height", "map", "map", "walker", 0, 12, 1.5, 0.25, Outcome.DONE, ""))
    story.say(facts.HandledDirectly("height", "map", "map", "walker", 0, 12, 1.75, 0.25, Outcome.FAILED, "fog"))
    history = story.say(facts.LostDirectly("walker", "pose", 2), facts.LostDirectly("walker", "pose", 1)).fold()
    assert [(one.name, one.direct_from, one.start, one.end, one.outcome) for one in history.handlings] == [
        ("height", "walker", 1.25, 1.5, Outcome.DONE),
        ("height", "walker", 1.5, 1.75, Outcome.FAILED),
    ]
    assert not history.messages
    (row,) = chart(history).rows
    assert [bar.ending for bar in row.handled] == ["", "failed"]
    title = "height, directly from walker, handled by map from 1.250 s to 1.500 s, 250 ms"
    assert row.handled[0].title() == title


def test_a_note_of_a_direct_message_with_impossible_times() -> None:
    """A module may tell anything; what it handled began before it ended, and that before central was told."""
    story = Story().module("map", "height").at(2.0)
    for ended, seconds in ((1.5, -1e308), (float("inf"), 0.5), (float("nan"), 1.0), (9.0, 0.5), (-4.0, float("nan"))):
        story.say(facts.HandledDirectly("height", "map", "map", "x", 0, 1, ended, seconds, Outcome.DONE, ""))
    handlings = story.at(3.0).fold().handlings
    assert [(one.start, one.end) for one in handlings] == [(1.5, 1.5), (1.5, 2.0), (0.0, 0.0), (1.5, 2.0), (0.0, 0.0)]


def test_what_is_suspended_from_above_waits_for_that_to_be_resumed() -> None:
    """However deep, and whatever else it would wait for: a queue, its parent, the one before it."""
    story = Story().module("planner", "walk").module("legs", "move")
    walk = story.goal("walk", "user", to="planner", begins=True)
    step = story.goal("walk", "planner", walk)
    first = story.command("move", "planner", step)
    held = story.command("move", "planner", step, sequential_achievement(TaskId(first), THIS))
    story.delivered(step, "planner").reached(step, Moment.START_ACHIEVING).returned(step).delivered(first, "legs")
    queued = story.command("move", "planner", walk)
    story.queued(queued, "legs").at(1.0).say(facts.SuspendedOrResumed(TaskId(walk), True))
    late = story.at(2.0).command("move", "planner", step)
    known = story.fold()
    for task in (held, queued, late):
        assert reasons(known, task) == [f"until walk {{{walk}}} is resumed"]
    assert reasons(known, step) == [
        f"until the handler of move {{{first}}} returns",
        f"until walk {{{walk}}} is resumed",
    ]
    assert reasons(known, first) == []  # its handler runs on
    assert reasons(story.fold(0.5), held) == [f"until move {{{first}}} is achieved"]
    story.at(3.0).say(facts.SuspendedOrResumed(TaskId(walk), False))
    assert reasons(story.fold(), held) == [f"until move {{{first}}} is achieved"]
    story.at(4.0).say(facts.SuspendedOrResumed(TaskId(step), True))
    known = story.fold()
    assert reasons(known, held) == [f"until walk {{{step}}} is resumed"]
    assert reasons(known, queued) == ["for legs, busy with move {3}"]


def told_late() -> Story:
    """Three notes of one slot, of whose handling it tells with one header at 2.0; a fourth has begun."""
    story = Story()
    for number in (1, 2, 3, 4):
        story.at(1.0 + number / 10).say(
            facts.Received(number, "note", MessageClass.INFORM, "user", TaskId(0), 0, False, b"", [])
        )
        story.say(facts.Delivered(1, 1, "ear", "ear", 1) if number == 1 else facts.Queued(number, number, "ear", "ear"))
    story.at(2.0)
    for number, began, ended in ((1, 0.0, 1.6), (2, 1.6, 1.7), (3, 1.8, 1.9)):
        if began:
            story.say(facts.Delivered(number, number, "ear", "ear", 1, began=began))
        story.say(facts.Returned(number, Outcome.DONE, b"", ended))
    story.say(facts.Delivered(4, 4, "ear", "ear", 1, began=1.95))
    return story


def test_handlers_ran_when_their_slot_says_so() -> None:
    history = told_late().fold()
    assert [(one.start, one.end) for one in history.handlings] == [(1.1, 1.6), (1.6, 1.7), (1.8, 1.9), (1.95, None)]
    assert [(one.start, one.end) for one in history.queueings] == [(1.2, 1.6), (1.3, 1.8), (1.4, 1.95)]


@pytest.mark.parametrize(
    ("time", "waits", "runs"), [(1.5, [2, 3, 4], [1]), (1.65, [3, 4], [2]), (1.75, [3, 4], []), (1.85, [4], [3])]
)
def test_what_was_so_at_a_moment_is_known_though_it_was_told_later(
    time: float, waits: list[int], runs: list[int]
) -> None:
    at = RunAt(told_late().fold(), time)
    assert [one.message_id for one in at.run.queueings if one.goes_on(time)] == waits
    assert [one.message_id for one in at.run.handlings if one.goes_on(time)] == runs


@given(st.lists(st.floats(0, 3), min_size=6, max_size=6))
def test_runs_of_a_slot_never_overlap_whatever_it_says(said: list[float]) -> None:
    story = told_late()
    told = story.entries[-1].facts
    told.clear()
    for number in (1, 2, 3):
        if number > 1:
            told.append(facts.Delivered(number, number, "ear", "ear", 1, began=said[number]))
        told.append(facts.Returned(number, Outcome.DONE, b"", said[number + 2]))
    runs = story.fold().handlings
    assert all(before.until <= after.start for before, after in pairwise(runs))
    assert all(run.start <= run.until <= 2.0 for run in runs)


def test_a_task_that_went_well_takes_little_room() -> None:
    """A run may have millions of them."""
    many, story = 500, Story().module("legs", "move")
    for number in range(many):
        move = story.at(float(number)).command("move", "user")
        story.queued(move, "legs").delivered(move, "legs").reached(move, *Moment).returned(move)
    tracemalloc.start()
    history = History.until(story.entries, with_turns=False)
    size, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(history.tasks) == many
    assert size / many < 1500  # bytes; with a list for all that a task may have twice as many
