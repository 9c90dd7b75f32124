"""What a task waits for in the end: named with why it stands, from however far; circles are told as such."""

from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result
from tools.story import THIS, Story, delayed, stuck

from tca_tools.run.at_time import RunAt, TaskAt
from tca_tools.tasktree_viz import words
from tca_tools.why.ends import MOST, Ends, causes
from tca_tools.why.wait_words import Age, Last, in_the_end, last_of, reasons
from tca_wire.constraints import Constraint, delay_planning, sequential_achievement
from tca_wire.journal import facts
from tca_wire.points import Moment, Point, TaskId
from tca_wire.vocabulary import MessageClass
from tca_wire.waits import WaitKind

Tca = Callable[..., Result]

SINCE_1 = Age(1.0, 1.0)


def _end(at: RunAt, task: TaskAt) -> str:
    return str(in_the_end(at, task) or "")


def _causes(at: RunAt) -> tuple[int, int, list[tuple[str, int, int]]]:
    waiting, things, found = causes(at)
    return waiting, things, [(str(last_of(at, one.ends[0])), one.tasks, one.first) for one in found]


def test_the_end_of_a_chain_is_told_from_however_far() -> None:
    at = RunAt(stuck(6_000).fold())
    end = "for calibrate {3}, which no module handles"
    assert [_end(at, at.tasks[number]) for number in (1, 2, 3, 6_002)] == [end, end, "", end]
    assert _causes(at) == (6_002, 1, [("for calibrate {3}, which no module handles", 6_002, 1)])
    before = RunAt(at.run, 1.5)
    assert _end(before, before.tasks[1]) == ""  # the drill has a handler, and it is what is next


def test_of_several_ends_what_stands_is_named_and_the_others_are_counted() -> None:
    story = Story().module("brain", "mission").module("rig", "drill").at(1.0)
    mission = story.goal("mission", "user", to="brain", begins=True)
    story.command("drill", "brain", mission, to="rig")
    story.queued(story.command("paint", "brain", mission)).returned(mission)
    at = RunAt(story.fold())
    assert _end(at, at.tasks[1]) == "for paint {3}, which no module handles, and for 1 other"
    for _ in range(MOST + 5):
        story.queued(story.command("paint", "brain", mission))
    at = RunAt(story.fold())
    assert _end(at, at.tasks[1]).endswith(f", and for {MOST} or more others")
    waiting, things, (first, *_) = _causes(at)
    assert (waiting, things) == (MOST + 7, 2)
    assert first == ("for paint {3}, which no module handles", MOST + 7, 1)


def test_of_what_is_named_already_the_others_are_others_that_are_waited_for() -> None:
    """They are not others that handle it."""
    story = Story().module("baker", "plan", "bake").module("oven", "bake").at(1.0)
    plan = story.goal("plan", "user", to="baker", begins=True)
    for _ in range(2):
        story.delivered(story.command("bake", "baker", plan), "oven")
    last = story.command("eat", "user", 0, sequential_achievement(TaskId(plan), THIS))
    at = RunAt(story.at(4.0).fold())
    assert _end(at, at.tasks[last]) == "for plan {1}, which baker handles, and for 2 others"
    told = "waits until plan {1} is achieved, for 3 s; baker handles that; in the end also for 2 others"
    assert words.note(at, at.tasks[last]) == told


def test_a_circle_is_told_as_one() -> None:
    """Central lets none come about; a journal may tell of one all the same."""
    story = Story().module("a", "walk").module("b", "look").at(1.0)
    walk, look = story.command("walk", "user"), story.command("look", "user")
    story.delivered(walk, "a").delivered(look, "b").at(2.0)
    story.say(facts.WaitBegan("a", walk, TaskId(look), Moment.END_ACHIEVING))
    story.say(facts.WaitBegan("b", look, TaskId(walk), Moment.END_ACHIEVING))
    after = story.command("rest", "user", 0, sequential_achievement(TaskId(walk), THIS))
    at = RunAt(story.fold())
    assert _end(at, at.tasks[after]) == "for walk {1}, which waits for itself by way of look {2}"
    assert _end(at, at.tasks[look]) == "for walk {1}, which waits for itself by way of look {2}"
    assert Ends.at(at).circle(1) == [1, 2]
    assert causes(at)[:2] == (3, 1)


def test_a_delay_that_has_not_begun_is_told_with_what_it_begins_with() -> None:
    at = RunAt(delayed().fold())
    assert words.note(at, at.tasks[2]) == (
        "waits until 3 s after ring bell {1} is achieved, for 1 s; that waits until 500.250 s"
    )


def test_the_text_of_a_story_says_it_too(tca: Tca, tmp_path: Path) -> None:
    told = tca("tree", stuck().write(tmp_path / "stuck"), "--story", 6).stdout
    assert told.splitlines()[2] == "waits in the end for calibrate {3}, which no module handles"


STANDS = Last("calibrate {3}", 3, "no module handles", "no module handles that", 0)
LATE = Last("ring bell {12}", 12, "waits until 500.250 s", "that waits until 500.250 s", 2)
CAUSE = "waits until a very long name of a step {7} is achieved"
END = "in the end for calibrate {3}"
WAITS = words.Note(CAUSE, SINCE_1, STANDS)
IS_NAMED = words.Note("waits until calibrate {3} is achieved", SINCE_1, STANDS, is_named=True)
IN_ALL = words.Note("waits until walk {7} is achieved", Age(3.0, 1.0))
ONLY_END = words.Note("", None, LATE)


@pytest.mark.parametrize(
    ("note", "room", "told"),
    [
        (WAITS, None, f"{CAUSE}, for 3 s; {END}, which no module handles"),
        (WAITS, 95, f"{CAUSE}, for 3 s; {END}"),
        (WAITS, 84, f"{CAUSE}; {END}"),
        (WAITS, 63, f"waits until a very long name of …; {END}"),
        (WAITS, 56, CAUSE),
        (WAITS, 20, "waits until a very …"),
        (IN_ALL, None, "waits until walk {7} is achieved, for 1 s (3 s in all)"),
        (IN_ALL, 50, "waits until walk {7} is achieved, for 3 s in all"),
        (IN_ALL, 45, "waits until walk {7} is achieved"),  # not for one second: that would mislead
        (ONLY_END, 49, "in the end for ring bell {12}, and for 2 others"),  # no duration alone: of what is it?
        (ONLY_END, 20, "for ring bell {12}"),
        (ONLY_END, 14, "for ring… {12}"),
        (IS_NAMED, 80, "waits until calibrate {3} is achieved, for 3 s; no module handles that"),
        (IS_NAMED, 61, "waits until calibrate {3} is achieved; no module handles that"),
    ],
)
def test_what_is_told_of_waits_gives_way_before_their_end_and_the_cause_last(
    note: words.Note, room: int | None, told: str
) -> None:
    assert note.within(room, 4.0) == told


def test_who_plans_ahead_waits_for_what_keeps_it_from_being_achieved() -> None:
    """And not for what it has planned, which waits for it: that is no circle."""
    story = Story().module("boss", "harvest", "row").at(1.0)
    west = story.goal("harvest", "user")
    story.say(facts.SuspendedOrResumed(TaskId(west), True, "op"))
    east = story.goal("harvest", "user", 0, sequential_achievement(TaskId(west), THIS), to="boss")
    row = story.goal("row", "boss", east)
    later = story.goal("row", "boss", east, delay_planning(THIS))
    story.delivered(row, "boss").returned(row).reached(row, Moment.END_PLANNING).returned(east)
    at = RunAt(story.fold())
    end = f"for harvest {{{west}}}, which is suspended by op"
    assert [_end(at, at.tasks[one]) for one in (east, row, later)] == [end] * 3
    assert causes(at)[:2] == (4, 1)


def test_what_is_queued_waits_for_the_first_slot_that_comes_free() -> None:
    story = Story().module("boss").module("rig", "job").say(facts.ResourceChanged("rig", "rig", 2)).at(1.0)
    stuck_one, other, queued = (story.command("job", "user") for _ in range(3))
    part = story.command("calibrate", "rig", stuck_one)
    story.delivered(stuck_one, "rig").delivered(other, "rig").queued(queued, "rig").queued(part)
    story.say(facts.WaitBegan("rig", stuck_one, TaskId(part), Moment.END_ACHIEVING))
    at = RunAt(story.fold())
    assert "calibrate" not in _end(at, at.tasks[queued])
    story.at(2.0).say(facts.WaitBegan("rig", other, TaskId(part), Moment.END_ACHIEVING))
    at = RunAt(story.fold())
    assert "calibrate" in _end(at, at.tasks[queued])


def test_a_lock_that_is_next_in_line_is_told_though_there_is_room() -> None:
    story = Story().module("boss").module("rig", "job").say(facts.ResourceChanged("rig", "rig", 2)).at(1.0)
    runs = story.command("job", "user", to="rig")
    story.at(2.0)
    first, second = story.command("lock up", "user"), story.command("lock up", "user")
    story.delivered(first, "boss").delivered(second, "boss")
    story.say(facts.Claimed(50, "rig", "rig", False, "boss", first)).at(3.0)
    story.say(facts.Claimed(51, "rig", "rig", False, "boss", second)).at(4.0)
    queued = story.command("job", "user")
    at = RunAt(story.queued(queued, "rig").fold())
    assert words.note_of(at, at.tasks[queued]).text == (
        f"waits for rig, which boss waits to lock while handling lock up {{{first}}}"
    )
    assert _end(at, at.tasks[queued]) == f"for job {{{runs}}}, which rig handles"
    (why,) = reasons(at, at.tasks[second])
    assert why.startswith(f"for the lock of rig {{51}}, busy with job {{{runs}}}, and which boss waits to lock first ")
    assert why.endswith(f" while handling lock up {{{first}}}")


def test_a_lock_that_was_wanted_later_keeps_nobody_out() -> None:
    story = Story().module("boss").module("rig", "job").say(facts.ResourceChanged("rig", "rig", 1)).at(1.0)
    runs, queued = story.command("job", "user"), story.command("job", "user")
    story.delivered(runs, "rig").queued(queued, "rig").at(2.0)
    story.say(facts.Claimed(50, "rig", "rig", False, "boss", 0))
    at = RunAt(story.fold())
    assert reasons(at, at.tasks[queued]) == [f"for rig, busy with job {{{runs}}}"]


def test_what_is_to_be_planned_is_not_waited_for_where_only_the_start_is() -> None:
    """Planned one ahead: the next goal is held until this one is begun, which another task keeps from that."""
    story = Story().module("boss", "harvest", "row").module("rig", "mow").at(1.0)
    mow = story.command("mow", "user", to="rig")
    harvest = story.goal("harvest", "user", 0, sequential_achievement(TaskId(mow), THIS), to="boss")
    row = story.goal("row", "boss", harvest)
    begun = Point(TaskId(row), Moment.START_ACHIEVING), Point(THIS, Moment.START_PLANNING)
    following = story.goal("row", "boss", harvest, Constraint(*begun))
    story.delivered(row, "boss").queued(story.command("calibrate", "boss", row)).returned(harvest)
    at = RunAt(story.fold())
    assert _end(at, at.tasks[following]) == f"for mow {{{mow}}}, which rig handles"


def test_what_is_planned_is_not_waited_for_where_only_the_plan_is() -> None:
    story = Story().module("boss", "harvest", "row").module("rig", "mow").at(1.0)
    harvest = story.goal("harvest", "user", to="boss", begins=True)
    mow, row = story.command("mow", "boss", harvest), story.goal("row", "boss", harvest)
    story.delivered(mow, "rig").queued(row).returned(harvest)
    planned = Constraint(Point(TaskId(harvest), Moment.END_PLANNING), Point(THIS, Moment.START_HANDLING))
    report = story.command("report", "user", 0, planned)
    at = RunAt(story.fold())
    assert _end(at, at.tasks[report]) == f"for row {{{row}}}, which no module handles"


def test_monitors_that_watch_do_not_wait() -> None:
    story = Story().module("boss").at(1.0)
    watch = story.received("watch", MessageClass.POLLING_MONITOR, "user", 0)
    story.reached(watch, Moment.START_HANDLING, Moment.START_PLANNING, Moment.START_ACHIEVING)
    at = RunAt(story.fold())
    assert Ends.at(at).of(watch)[0].kind is WaitKind.CONDITION
    assert causes(at) == (0, 0, [])
