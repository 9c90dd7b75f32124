"""What keeps a task that a wiretap, a handler that ignores a kill, or an answer that does not come holds up; and what is
to come: told in rows and stories alike.
"""

from collections.abc import Callable
from pathlib import Path

import pytest
from central.player import Player
from click.testing import Result
from tools.story import QUERY, THIS, Story, delayed, stuck

from tca_tools.analysis.failures import failures
from tca_tools.analysis.long_waits import long_waits as waits
from tca_tools.explain.ends import Ends, causes
from tca_tools.explain.story import story
from tca_tools.explain.wait_words import Age, Last, in_the_end, last_of, reasons
from tca_tools.journal.at_time import RunAt, TaskAt
from tca_tools.journal.fates import Fate
from tca_tools.journal.fold import History
from tca_tools.journal.records import TaskState
from tca_tools.journal.selection import waited_for
from tca_tools.tasktree_viz import words
from tca_tools.tasktree_viz.failing import failure_chain
from tca_tools.tasktree_viz.words import note
from tca_wire.constraints import Constraint, delay_planning, sequential_achievement
from tca_wire.journal import facts
from tca_wire.packets import headers
from tca_wire.packets.parts import Attachment
from tca_wire.points import ROOT, Moment, Point, TaskId
from tca_wire.vocabulary import Condition, MessageClass, Scope
from tca_wire.waits import WaitKind
from tca_wire.waits.ends import MOST


def noted(history: History, task: int, time: float | None = None) -> str:
    at = RunAt.by_clock(history, time)
    return note(at, at.tasks[task])


def told(history: History, task: int) -> list[str]:
    return [one.text for one in story(history, task)]


def folded(player: Player) -> History:
    return History.until(player.entries)


def robot() -> Player:
    """Legs that move, a checker, an expert, and a user."""
    player = Player()
    player.module("user")
    player.module("legs", "command move", "goal walk")
    player.module("checker", "command check")
    player.module("expert", "exception handler mend", "exception handler replan")
    return player


def tapped(player: Player) -> int:
    """A move that a wiretap of the checker holds while it is checked."""
    tap = headers.Tap(player.number("checker"), Condition.BEFORE_HANDLING, "check", "move", ROOT, None)
    player.receive("checker", tap)
    return player.task("user", "move")


def test_a_task_that_a_wiretap_holds_names_the_listener_and_whose_it_is() -> None:
    player = robot()
    move = tapped(player)
    history = folded(player)
    check = history.tasks[move].children[0]
    assert history.tasks[move].state is TaskState.HELD
    reason = f"until check {{{check}}}, the listener of a wiretap by checker, has been handled"
    assert noted(history, move) == f"waits {reason}"
    assert f"held, {reason}" in told(history, move)
    player.tick(5.0)
    player.send("user", "walk")
    longest = waits(folded(player))[0].longest[0]
    assert (longest.who, longest.is_open) == (f"move {{{move}}}", True)
    assert f"until check {{{check}}}, the listener of a wiretap" in longest.what


def test_what_is_to_be_handled_again_says_that_a_wiretap_holds_it() -> None:
    player = robot()
    tap = headers.Tap(player.number("checker"), Condition.BEFORE_HANDLING, "check", "move", ROOT, None)
    player.receive("checker", tap)
    move = player.task("user", "move", attachments=[Attachment("slip", "mend", 0)])
    player.reply("checker/1")
    player.fail("legs/1", "slip")
    player.receive("expert/1", headers.Retry(player.number("expert/1"), TaskId(move)))
    player.reply("expert/1")
    history = folded(player)
    check = history.tasks[move].children[-1]
    assert history.name(check) == "check"
    assert told(history, move)[-1] == f"achieving, until check {{{check}}} has ended"


def test_a_killed_task_whose_handler_runs_has_not_ended() -> None:
    player = robot()
    move = player.task("user", "move")
    player.receive("user", headers.Kill(player.number("user"), TaskId(move), "too slow"))
    player.tick(28.0)
    player.task("user", "walk")
    history = folded(player)
    assert history.tasks[move].state is TaskState.ENDING
    assert noted(history, move) == "killed: too slow (by user); waits until its handler returns, for 29 s"
    player.reply("legs/1")
    history = folded(player)
    end = history.tasks[move].reached[Moment.END_ACHIEVING]
    assert history.tasks[move].states[-1] == (end, TaskState.KILLED)
    assert told(history, move)[-3:] == ["killed: too slow (by user)", "ending, until its handler returns", "has ended"]


def test_a_handler_that_goes_on_while_it_waits_for_a_reply() -> None:
    tale = Story().module("aio", "look").module("bee", "where").at(1.0)
    look = tale.command("look", "user", to="aio")
    where = tale.at(2.0).received("where", QUERY, "aio", origin=look, to="bee")
    tale.at(6.0).command("look", "user")
    history = tale.fold()
    assert (
        noted(history, look) == f"goes on while it waits for the reply to where {{{where}}}, which bee handles, for 4 s"
    )
    assert f"its handler asked where {{{where}}}, and goes on; bee handles it" in told(history, look)
    tale.at(7.0).returned(where).say(facts.Answered(where))
    assert noted(tale.fold(), look) == ""


def test_deadlines_and_kills_that_are_to_come() -> None:
    player = robot()
    move = player.task("user", "move", deadline=100.0)
    other = player.task("user", "move")
    kill = headers.Kill(player.number("user"), TaskId(other), "", Scope.TASK, None, 800.0)
    player.receive("user", kill)
    begun = player.time
    history = folded(player)
    sent = history.tasks[move].received
    assert noted(history, move) == f"deadline: end achieving by {sent + 100:.3f} s"
    assert noted(history, other) == (
        f"waits until move {{{move}}} is achieved (is to be killed by user at {begun + 800:.3f} s), for 1 s"
    )
    assert f"deadline: end achieving by {sent + 100:.3f} s" in told(history, move)
    player.reply("legs/1")
    assert noted(folded(player), move) == ""
    player.tick(900.0)
    assert noted(folded(player), other).startswith("killed: ")


def test_a_kill_after_a_point_says_after_which() -> None:
    player = robot()
    first, second = player.task("user", "move"), player.task("user", "walk")
    point = Point(TaskId(first), Moment.END_ACHIEVING)
    player.receive("user", headers.Kill(player.number("user"), TaskId(second), "", Scope.TASK, point, 3.0))
    assert f"is to be killed by user 3 s after move {{{first}}} is achieved" in noted(folded(player), second)


def test_an_exception_handler_that_has_been_called_as_often_as_it_may() -> None:
    player = robot()
    player.declare("user", "command move")
    move = player.task("user", "move", attachments=[Attachment("slip", "mend", 1)])
    player.fail("legs/1", "slip")
    retry = headers.Retry(player.number("expert/1"), TaskId(move))
    player.receive("expert/1", retry)
    player.reply("expert/1")
    player.fail("legs/1", "slip")
    history = folded(player)
    said = "mend had been called once, as often as it may"
    assert told(history, move)[-2] == f"exception handler {said}"
    assert f"exception handler {said}" in [link.text for link in failure_chain(history, TaskId(move))]
    last = failures(history)[0].cases[-1]
    assert (last.fate, last.called) == (Fate.NOT_HANDLED, [said])


def test_an_exception_handler_that_passes_the_failure_on() -> None:
    player = robot()
    attachments = [Attachment("slip", "replan", 0), Attachment("slip", "mend", 0)]
    move = player.task("user", "move", attachments=attachments)
    player.fail("legs/1", "slip")
    mend = folded(player).tasks[move].caught_by[0]
    player.fail("expert/1", "slip", reissue=True)
    history = folded(player)
    assert f"mend {{{mend}}} passes the failure on" in told(history, move)
    assert f"passes the failure of move {{{move}}} on" in told(history, mend)
    assert failures(history)[0].cases[0].called[1] == f"mend {{{mend}}} passed the failure on"


def test_a_task_that_is_handled_again_does_not_wait_for_itself() -> None:
    tale = Story().module("oven", "bake").at(1.0)
    bake = tale.command("bake", "user")
    tale.queued(bake, "oven").delivered(bake, "oven").at(2.0)
    assert not [text for text in told(tale.fold(), bake) if text.startswith("queued")]


def test_a_lock_that_is_free_is_not_waited_for() -> None:
    tale = Story().module("arm", "move").module("waiter", "wait").at(1.0)
    wait = tale.command("wait", "user", to="waiter")
    tale.at(2.0).say(facts.Claimed(90, "arm", "arm", False, "waiter", wait), facts.Granted(90)).at(5.0)
    tale.say(facts.ClaimEnded(90, "released"))
    assert told(tale.fold(), wait)[2:] == ["its handler has the lock of arm {90}"]


def test_a_monitor_says_whether_its_condition_holds() -> None:
    tale = Story().at(1.0)
    watch = tale.received("until ready", MessageClass.POLLING_MONITOR, "user")
    tale.reached(watch, Moment.START_HANDLING, Moment.START_ACHIEVING)
    assert noted(tale.fold(), watch) == "watches for its condition until ready, which has not been tested"
    tale.at(2.0).say(facts.MonitorTested(TaskId(watch), False))
    assert noted(tale.fold(), watch) == "watches for its condition until ready, which did not hold, for 1 s"
    tale.at(5.0).say(facts.MonitorTested(TaskId(watch), True)).at(5.5)
    assert (
        noted(tale.fold(), watch) == "watches for its condition until ready, which held, for 500 ms"
    )  # it watches for longer, but waits not


def test_a_wait_goes_on_after_a_suspension() -> None:
    tale = Story().module("legs", "move").at(1.0)
    move = tale.command("move", "user", to="legs")
    behind = tale.at(2.0).command("move", "user", ROOT, sequential_achievement(TaskId(move), THIS))
    tale.at(4.0).say(facts.SuspendedOrResumed(TaskId(behind), True)).at(5.0)
    assert noted(tale.fold(), behind) == "waits until move {2} is resumed, for 1 s"
    tale.say(facts.SuspendedOrResumed(TaskId(behind), False)).at(7.0)
    assert noted(tale.fold(), behind) == "waits until move {1} is achieved, for 2 s (5 s in all)"


def test_a_task_that_fails_under_what_was_killed_already_goes_on() -> None:
    """What survives a kill may fail, and nobody handles that: it is not over, and its failure was not dealt with."""
    tale = Story().module("legs", "move").at(1.0)
    move = tale.command("move", "user")
    tale.at(2.0).say(facts.Failed(move, "slip", "", True), facts.Unhandled(TaskId(move)))
    assert tale.fold().tasks[move].state is TaskState.HELD
    assert failures(tale.fold())[0].cases[0].fate is Fate.NOT_HANDLED


def queue_of_three() -> tuple[Story, list[int]]:
    """Three moves are handled for a second, for three and for two, the last one still; a fourth waits for them."""
    story = Story().module("legs", "move").at(1.0)
    moves = [story.command("move", "user") for _ in range(4)]
    story.delivered(moves[0], "legs")
    for move in moves[1:]:
        story.queued(move, "legs")
    for before, move, time in zip(moves, moves[1:3], (2.0, 5.0), strict=False):
        story.at(time).returned(before).delivered(move, "legs")
    story.at(7.0).command("rest", "user")
    return story, moves


def test_all_that_a_message_waited_for_is_told_in_its_row_its_report_and_its_chart() -> None:
    story, (*others, last) = queue_of_three()
    run = story.fold()
    told = [note(at := RunAt(run, time), at.tasks[last]) for time in (1.5, 4.0, 7.0)]
    assert told == [
        "waits for legs, busy with move {1}, for 500 ms",
        "waits for legs, busy with move {2}, for 2 s (3 s in all)",
        "waits for legs, busy with move {3}, for 2 s (6 s in all)",
    ]
    (queued,) = [one for kind in waits(run) for one in kind.longest if one.who == f"move {{{last}}}"]
    assert queued.what == "for legs, busy with move {1} (1 s); busy with move {2} (3 s); busy with move {3} (2 s)"
    assert waited_for(run, TaskId(last), {last}) == set(others)


# --- what a task waits for in the end --------------------------------------------------------------------------------


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
    assert Ends.at(at).members(Ends.at(at).of(walk)[0]) == [walk, look]
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
WAITS = words.TaskNote(CAUSE, SINCE_1, STANDS)
IS_NAMED = words.TaskNote("waits until calibrate {3} is achieved", SINCE_1, STANDS, is_named=True)
IN_ALL = words.TaskNote("waits until walk {7} is achieved", Age(3.0, 1.0))
ONLY_END = words.TaskNote("", None, LATE)


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
    note: words.TaskNote, room: int | None, told: str
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
    end = f"for harvest {{{west}}}, which is suspended since its birth by op"
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
