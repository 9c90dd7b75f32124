"""Stories, waits and critical paths of runs that are too long for told/, and texts cut to fit
narrow rows.
"""

from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result
from tools.story import Story, stuck, stumbling

from tca_tools.analysis.backwards import Causes
from tca_tools.analysis.critical_path import critical_path
from tca_tools.analysis.failures import failures
from tca_tools.analysis.long_waits import long_waits
from tca_tools.analysis.summary import summary
from tca_tools.explain.graph import causes, waits_now
from tca_tools.explain.story import story
from tca_tools.explain.wait_words import Age, Last, in_the_end, last_of, reasons
from tca_tools.explain.waits import waits_for_display
from tca_tools.journal.at_time import RunAt, TaskAt
from tca_tools.journal.fates import Fate
from tca_tools.journal.fold import History
from tca_tools.report.contents import contents
from tca_tools.tasktree_viz import words
from tca_wire.journal import facts
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import MessageClass, Refusal
from tca_wire.waits.ends import MOST

Tca = Callable[..., Result]


def story_lines(history: History, message: int) -> list[str]:
    return [
        f"{one.time:.1f} {'' if one.seconds is None else f'({one.seconds:.1f} s) '}{one.text}"
        for one in story(history, message)
    ]


def test_unknown_message_has_an_empty_story() -> None:
    assert story(stumbling().fold(), 99) == []


def test_story_names_the_longest_of_many_causes() -> None:
    built = Story().module("legs", "move")
    moves = [built.command("move", "user") for _ in range(100)]
    for move in moves:
        built.queued(move, "legs")
    for time, move in enumerate(moves):
        built.at(time + 1.0).delivered(move, "legs").at(time + 2.0).achieved(move)
    (wait,) = [one for one in story_lines(built.fold(), 100) if "queued" in one]
    assert wait.startswith("0.0 (100.0 s) queued for legs, busy with move")
    assert wait.endswith("and 97 more (97 s)")
    known = story(built.fold(until=50.5), 100)
    assert [one.text_at(50.5, 50.5) for one in known] == [
        one.text_at(50.5, 50.5) for one in story(built.fold(), 100, 50.5) if one.time <= 50.5
    ]


def test_story_of_1000_subtasks_names_a_few_and_counts_the_rest() -> None:
    built = Story().module("boss", "walk").module("legs", "move").at(1.0)
    walk = built.goal("walk", "user", to="boss", begins=True)
    moves = [built.command("move", "boss", walk) for _ in range(1000)]
    run = (
        built.returned(walk)
        .at(2.0)
        .delivered(moves[0], "legs")
        .at(3.0)
        .achieved(moves[0])
        .at(4.0)
        .fold()
    )
    at = RunAt(run)
    assert reasons(at, at.tasks[walk]) == [
        "until move {3}, move {4}, move {5} and 996 more are achieved"
    ]
    assert (
        len(waits_now(at, walk)),
        len(waits_for_display(run, run.tasks[walk], together=True)),
    ) == (
        4,
        3,
    )
    kept = "achieving, until move {2}, move {3}, move {4} and 997 more are achieved"
    assert story_lines(run, walk)[-1] == f"1.0 {kept}"


def final_wait(at: RunAt, task: TaskAt) -> str:
    return str(in_the_end(at, task) or "")


def cause_texts(at: RunAt) -> tuple[int, int, list[tuple[str, int, int]]]:
    waiting, things, found = causes(at)
    return waiting, things, [(str(last_of(at, one.ends[0])), one.tasks, one.first) for one in found]


def test_end_of_a_long_chain_is_found() -> None:
    at = RunAt(stuck(6_000).fold())
    end = "for calibrate {3}, which no module handles"
    assert [final_wait(at, at.tasks[number]) for number in (1, 2, 3, 6_002)] == [end, end, "", end]
    assert cause_texts(at) == (6_002, 1, [("for calibrate {3}, which no module handles", 6_002, 1)])
    before = RunAt(at.run, 1.5)
    assert (
        final_wait(before, before.tasks[1]) == ""
    )  # the drill still works: it is the end of the chain


def test_several_ends_name_the_stuck_one_and_count_the_others() -> None:
    story = Story().module("brain", "mission").module("rig", "drill").at(1.0)
    mission = story.goal("mission", "user", to="brain", begins=True)
    story.command("drill", "brain", mission, to="rig")
    story.queued(story.command("paint", "brain", mission)).returned(mission)
    at = RunAt(story.fold())
    assert final_wait(at, at.tasks[1]) == "for paint {3}, which no module handles, and for 1 other"
    for _ in range(MOST + 5):
        story.queued(story.command("paint", "brain", mission))
    at = RunAt(story.fold())
    assert final_wait(at, at.tasks[1]).endswith(f", and for at least {MOST} others")
    waiting, things, (first, *_) = cause_texts(at)
    assert (waiting, things) == (MOST + 7, 2)
    assert first == ("for paint {3}, which no module handles", MOST + 7, 1)


def test_story_text_names_the_end_of_the_chain(tca: Tca, tmp_path: Path) -> None:
    text = tca("tree", stuck().write(tmp_path / "stuck"), "--story", 6).stdout
    assert text.splitlines()[2] == "waits in the end for calibrate {3}, which no module handles"


STANDS = Last("calibrate {3}", 3, "no module handles", 0)
WAITS = words.TaskNote("waits until step {7} is achieved", Age(2.0, 1.0), STANDS)


@pytest.mark.parametrize(
    ("room", "note"),
    [
        (
            None,
            "waits until step {7} is achieved, for 2 s (3 s in all); in the end for calibrate {3}, which no module handles",
        ),
        (
            93,
            "waits until step {7} is achieved; in the end for calibrate {3}, which no module handles",
        ),
        (20, "waits until step {7…"),
    ],
)
def test_narrow_note_drops_durations_first(room: int | None, note: str) -> None:
    assert WAITS.within(room, 4.0) == note


CIRCLE = "each waits for the next, in a cycle: a waits for b; b waits for a"


def test_deadlock_outside_handlers_is_told_to_its_program() -> None:
    deadlocked = Story().module("user").module("k", "slow").at(1.0)
    slow = deadlocked.command("slow", "user", to="k")
    deadlocked.at(2.0).say(facts.WaitBegan("user", 0, TaskId(slow), Moment.END_ACHIEVING)).at(3.0)
    deadlocked.say(
        facts.RequestRefused("user", Refusal.DEADLOCK, CIRCLE),
        facts.WaitEnded("user", 0, TaskId(slow)),
    )
    run = deadlocked.at(4.0).fold()
    (kind,) = failures(run)
    assert (kind.cases[0].of, kind.cases[0].fate, kind.message) == ("user", Fate.REPORTED, "slow")
    assert contents(run).stories == {}


def test_critical_path_of_2000_queries_is_complete() -> None:
    story = Story().module("a", "count").module("b", "add")
    count = story.at(1.0).goal("count", "x", to="a", begins=True)
    for number in range(2_000):
        story.at(2.0 + number).query("add", "a", count, "b", took=0.5)
    story.at(3_000.0).returned(count).reached(count, Moment.END_PLANNING, Moment.END_ACHIEVING)
    run = story.fold()
    steps = critical_path(run, Causes(run), run.tasks[TaskId(count)]).steps
    assert len([step for step in steps if step.seconds > 1e-9]) == 4_001


def test_long_waits_keep_only_the_longest() -> None:
    story = Story().module("legs", "move")
    for number in range(30):
        story.at(10.0 * number).queued(move := story.command("move", "user"), "legs")
        story.at(10.0 * number + number / 10).delivered(move, "legs").returned(move)
    (kind,) = long_waits(story.fold(), at_most=3)
    assert (kind.number, [round(wait.seconds, 3) for wait in kind.longest]) == (29, [2.9, 2.8, 2.7])


def test_summary_counts_monitors_of_a_live_run() -> None:
    built = Story().at(1.0)
    built.received("battery watch", MessageClass.POLLING_MONITOR, "user")
    built.goal("walk", "user")
    run = built.fold()
    run.is_live = True
    assert summary(run).outcome.endswith("; 1 monitor still watching.")
