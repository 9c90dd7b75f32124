"""The stories of messages, as people read them."""

from pathlib import Path

from click.testing import CliRunner
from tools.story import ACTING, COMMAND, QUERY, THIS, Story, mopping, ordered, resumed_alone, stumbling

from tca_tools.explain.graph import waits_now
from tca_tools.explain.story import story
from tca_tools.explain.wait_words import reasons
from tca_tools.explain.waits import told_waits
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.fold import History
from tca_tools.journal.selection import messages_of
from tca_tools.tasktree_viz.__main__ import tree
from tca_tools.tasktree_viz.words import note
from tca_wire.constraints import sequential_achievement
from tca_wire.journal import facts
from tca_wire.points import ROOT, Moment, TaskId
from tca_wire.vocabulary import Condition, MessageClass, Outcome


def told(history: History, message: int) -> list[str]:
    return [
        f"{one.time:.1f} {'' if one.seconds is None else f'({one.seconds:.1f} s) '}{one.text}"
        for one in story(history, message)
    ]


def test_who_waited_for_a_task_that_was_killed_goes_on_and_is_told_why() -> None:
    tale = Story().module("legs", "walk", "sweep").at(1.0)
    walk = tale.goal("walk", "user")
    sweep = tale.command("sweep", "user", ROOT, sequential_achievement(TaskId(walk), THIS))
    tale.delivered(walk, "legs").at(3.0).returned(walk)
    tale.say(facts.Killed(TaskId(walk), "enough", "user")).reached(walk, *Moment).at(4.0)
    run = tale.delivered(sweep, "legs").fold()
    assert "1.0 (2.0 s) held, until walk {1} is achieved, but walk {1} came to nothing" in told(run, sweep)
    before = next(one for one in story(run, sweep, 2.0) if one.text.startswith("held"))
    assert before.by(2.0, 2.0) == "held, until walk {1} is achieved, 1.000 s so far"


def test_a_failure_that_is_handled_by_another_try() -> None:
    tale = Story().module("legs", "move").module("expert", "recover")
    move = tale.command("move", "user", to="legs")
    tale.at(1.0).failed(move, "slip", "")
    recover = tale.rescued(move, "recover", "expert")
    tale.at(1.5).say(facts.Retried(TaskId(move), b"\x07", "user")).returned(recover).reached(recover, *Moment)
    tale.delivered(move, "legs").at(2.0).achieved(move)
    history = tale.fold()
    assert told(history, move) == [
        "0.0 command sent by user",
        "0.0 (1.0 s) handled by legs: failed",
        "1.0 failed: slip",
        "1.0 exception handler recover {2} is called",
        "1.0 (0.5 s) recovering, until recover {2} has dealt with its failure",
        "1.5 to be handled again, with other data (retried by user)",
        "1.5 (0.5 s) handled by legs",
        "2.0 achieved",
    ]
    assert told(history, recover)[0] == "1.0 exception handler made by central for move {1}, under move {1}"


def test_a_monitor_that_tested_and_one_that_never_watched() -> None:
    tale = Story().module("user")
    watch = tale.received("watch", MessageClass.POLLING_MONITOR, "user")
    tale.reached(watch, ACTING)
    tests = [(1.0, False), (2.0, False), (3.0, True), (4.0, True), (5.0, False)]
    for time, holds in tests:
        tale.at(time).say(facts.MonitorTested(TaskId(watch), holds))
    tale.at(6.0).say(facts.MonitorEnded(TaskId(watch), "it has watched for 6 s"))
    tale.reached(watch, Moment.END_HANDLING | Moment.END_ACHIEVING)
    late = tale.received("watch", MessageClass.POLLING_MONITOR, "user")
    tale.at(7.0).say(facts.MonitorEnded(TaskId(late), "by module 'user'"))
    history = tale.fold()
    assert told(history, watch)[1:] == [
        "0.0 (6.0 s) watching",
        "1.0 (1.0 s) its condition does not hold, 2 times",
        "3.0 (1.0 s) its condition holds, 2 times",
        "5.0 its condition does not hold",
        "6.0 watches no longer: it has watched for 6 s",
        "6.0 achieved",
    ]
    assert "7.0 watches no longer: by module 'user'" in told(history, late)


def test_a_task_that_was_suspended_while_something_under_it_ran_and_resumed() -> None:
    history = mopping().fold()
    assert told(history, 1) == [
        "1.0 goal sent by user",
        "1.0 (0.5 s) handled by chef",
        "1.5 (0.5 s) achieving, until sweep {2}, sweep {3} and sweep {4} are achieved",
        "2.0 (7.0 s) suspended, until mop floor {1} is resumed",
        "2.0 (1.0 s) sweep {2} still runs",
        "9.0 resumed",
        "9.0 (2.0 s) achieving, until sweep {3} and sweep {4} are achieved",
        "11.0 achieved",
    ]
    assert told(history, 2)[-3:] == [
        "2.0 (1.0 s) suspended with mop floor {1}",
        "2.0 (1.0 s) its handler still runs",
        "3.0 achieved",
    ]


def test_a_handler_runs_on_only_in_a_suspension_that_came_later() -> None:
    assert told(resumed_alone().fold(), 2)[2:] == [
        "2.0 (2.0 s) suspended by panel, until walk {1} is resumed",
        "4.0 resumed",
        "4.0 (2.0 s) handled by legs",
        "5.0 (1.0 s) suspended by panel with walk {1}",
        "5.0 (1.0 s) its handler still runs",
        "6.0 achieved",
    ]
    at = RunAt(resumed_alone().fold(), 5.5)
    assert note(at, at.tasks[1]) == (
        "suspended by panel, until the handler of move {2} returns, and until walk {1} is resumed, for 1.5 s (3.5 s in all)"
    )


def test_a_task_that_was_created_suspended() -> None:
    history = ordered().fold()
    assert "2.0 (1.0 s) suspended since its birth by planner, until move {2} is resumed" in told(history, 2)
    at = RunAt(history, 2.5)
    assert note(at, at.tasks[2]) == "suspended since its birth by planner, until move {2} is resumed, for 500 ms"


def test_who_suspended_and_resumed_is_told_to_those_who_wait() -> None:
    history = mopping("operator panel").fold()
    assert told(history, 1)[3:6:2] == [
        "2.0 (7.0 s) suspended by operator panel, until mop floor {1} is resumed",
        "9.0 resumed by operator panel",
    ]
    assert "2.0 (1.0 s) suspended by operator panel with mop floor {1}" in told(history, 2)
    sweeping, standing = RunAt(history, 2.5), RunAt(history, 5.0)
    assert note(sweeping, sweeping.tasks[2]) == (
        "still runs, though mop floor {1} is suspended by operator panel, for 500 ms"
    )
    for task in (1, 3):
        words = "suspended by operator panel, until mop floor {1} is resumed, for 3 s"
        assert note(standing, standing.tasks[task]) == words
    typed = RunAt(mopping("tca suspend").fold(), 5.0)
    assert note(typed, typed.tasks[1]).startswith("suspended by the command 'tca suspend', until")


def test_who_killed_is_told_once_and_with_the_reason_that_was_given() -> None:
    tale = Story().module("chef", "mop floor").at(1.0)
    reasons = {"": "panel", "tired": "tca kill", "overload: one came": "central"}
    for why, by in reasons.items():
        mop = tale.goal("mop floor", "user")
        tale.say(facts.Killed(TaskId(mop), why, by)).reached(mop, *Moment)
    history = tale.fold()
    assert [told(history, task)[-1] for task in range(1, 4)] == [
        "1.0 killed: by panel",
        "1.0 killed: tired (by the command 'tca kill')",
        "1.0 killed: overload: one came",
    ]


def test_what_a_retried_task_sends_tells_in_what_it_was_sent() -> None:
    """A retried task is delivered under a new number: what it sends names that."""
    tale = Story().module("chef", "mop floor").module("shelf", "where is it", "get").at(1.0)
    mop = tale.goal("mop floor", "user", to="chef")
    tale.at(2.0).failed(mop, "no mop", "")
    again = 9
    tale.say(facts.Retried(TaskId(mop), b"", "user"), facts.Delivered(again, mop, "chef", "chef")).at(3.0)
    asked = tale.received("where is it", QUERY, "chef", origin=again)
    got = tale.command("get", "chef", mop, origin=again)
    tale.say(facts.Returned(again, Outcome.DONE, b"")).at(4.0)
    late = tale.received("where is it", QUERY, "chef", origin=again)  # from a thread that its handler left behind
    history = tale.fold()
    assert told(history, asked)[0] == "3.0 query sent by chef while handling mop floor {1}"
    assert told(history, got)[0] == "3.0 command sent by chef while handling mop floor {1}, under mop floor {1}"
    assert told(history, late)[0] == "4.0 query sent by chef while handling mop floor {1}"
    assert history.name(again) == "mop floor"
    assert messages_of(history, [mop]) == {mop, asked, late}


def test_a_task_that_was_killed_while_it_was_suspended_was_not_resumed() -> None:
    tale = mopping()
    tale.entries = [entry for entry in tale.entries if entry.time < 9.0]
    tale.at(4.0).say(*(facts.Killed(TaskId(task), "tired") for task in (1, 3, 4)))
    for task in (3, 4, 1):
        tale.reached(task, *Moment)
    history = tale.fold()
    assert told(history, 1)[-3:] == ["2.0 (2.0 s) suspended", "2.0 (1.0 s) sweep {2} still runs", "4.0 killed: tired"]
    assert "2.0 (2.0 s) suspended with mop floor {1}" in told(history, 3)


def test_of_what_is_unknown_there_is_no_story() -> None:
    assert story(stumbling().fold(), 99) == []


def waiting_for_two() -> Story:
    """A move {3} must wait for two others, which are achieved at 2 s and at 3 s."""
    tale = Story().module("legs", "move", "look").at(1.0)
    first, second = tale.command("move", "user"), tale.command("look", "user")
    tale.command("move", "user", 0, *(sequential_achievement(TaskId(one), THIS) for one in (first, second)))
    tale.delivered(first, "legs").delivered(second, "legs").at(2.0).achieved(first).at(3.0).achieved(second)
    return tale.delivered(3, "legs").at(4.0)


def test_a_story_at_a_moment_says_what_was_known_then(tmp_path: Path) -> None:
    tale = waiting_for_two()
    first, second = "held, until move {1} is achieved", "held, until look {2} is achieved"
    folder = tale.write(tmp_path / "walk")
    for moment, why in ((1.5, f"{first}, 0.500 s so far"), (2.5, f"{second}, 1.500 s so far")):
        printed = " ".join(CliRunner().invoke(tree, [str(folder), "--story", "3", "--at", str(moment)]).output.split())
        assert why in printed
        assert "handled" not in printed
        assert why in [one.by(moment, moment) for one in story(tale.fold(), 3, moment)]


MANY = "held, until move {1}, move {2}, move {3} and 3 more are achieved"


def waiting_for_many() -> Story:
    """A clean {7} must wait for six moves, which end one after the other; the second and the fifth are killed."""
    tale = Story().module("legs", "move", "clean").at(1.0)
    moves = [tale.command("move", "user") for _ in range(6)]
    clean = tale.command("clean", "user", 0, *(sequential_achievement(TaskId(one), THIS) for one in moves))
    for move in moves:
        tale.at(move + 1.0)
        if move in (2, 5):
            tale.say(facts.Killed(TaskId(move), "enough", "user")).reached(move, *Moment)
        else:
            tale.delivered(move, "legs").achieved(move)
    return tale.delivered(clean, "legs").at(8.0)


def test_a_wait_for_many_is_told_at_once_and_before_its_end_how_many_are_left() -> None:
    run = waiting_for_many().fold()
    assert told(run, 7)[1] == f"1.0 (6.0 s) {MANY}, but move {{2}} and move {{5}} came to nothing"
    for moment, text in ((1.5, MANY), (3.5, f"{MANY}, 4 of them still to come")):
        last = [one.known(moment) for one in story(run, 7, moment) if one.time <= moment][-1]
        assert (last.text, last.is_open) == (text, True)
    assert told(waiting_for_many().fold(until=3.5), 7)[-1] == f"1.0 {MANY}, 4 of them still to come"


def test_what_a_wiretap_held_last_is_not_said_to_have_held_all_the_time() -> None:
    tale = Story().module("legs", "move").module("checker", "check").at(1.0)
    tale.say(facts.TapAdded(90, Condition.BEFORE_HANDLING, "check", "move", ROOT, "safety"))
    first = tale.command("move", "user", to="legs")
    second = tale.command("move", "user", 0, sequential_achievement(TaskId(first), THIS))
    tale.at(4.0).achieved(first)
    check = tale.received("check", COMMAND, "central", parent=second)
    tale.say(facts.TapFired(90, second, check)).delivered(check, "checker")
    tale.at(4.2).returned(check).reached(check, *Moment).delivered(second, "legs").at(5.0)
    assert told(tale.fold(), second)[1:3] == [
        "1.0 (3.0 s) held, until move {1} is achieved",
        "4.0 (0.2 s) held, until check {3}, the listener of a wiretap by safety, has been handled",
    ]


def test_of_very_many_causes_the_first_and_the_last_are_told() -> None:
    tale = Story().module("legs", "move")
    moves = [tale.command("move", "user") for _ in range(100)]
    for move in moves:
        tale.queued(move, "legs")
    for time, move in enumerate(moves):
        tale.at(time + 1.0).delivered(move, "legs").at(time + 2.0).achieved(move)
    waits = [one for one in told(tale.fold(), 100) if "queued" in one]
    assert waits[1] == "1.0 (1.0 s) queued for legs, busy with move {1}"
    assert waits[-1] == "99.0 (1.0 s) queued for legs, busy with move {99}"
    assert waits[3] == "3.0 (94.0 s) queued for legs, kept busy by 94 others, one after the other"
    assert len(waits) == 7
    known = story(tale.fold(until=50.5), 100)
    assert [one.by(50.5, 50.5) for one in known] == [
        one.by(50.5, 50.5) for one in story(tale.fold(), 100, 50.5) if one.time <= 50.5
    ]


WAITS = "its handler waits for the"


def test_who_waits_for_a_reply_is_told_where_the_query_is() -> None:
    tale = Story().module("chef", "cook").at(1.0)
    cook = tale.goal("cook", "user")
    taste = tale.delivered(cook, "chef").received("taste", QUERY, "chef", origin=cook, blocking=True)
    tale.queued(taste)
    salt = tale.at(1.5).received("salt", QUERY, "chef", origin=cook)
    tale.queued(salt).at(2.0)
    asked, waits = "its handler asked salt {3}", "its handler waits for the reply to taste {2}"

    def of_handler(run: History) -> list[str]:
        return [one for one in told(run, cook) if "its handler" in one]

    assert of_handler(tale.fold()) == [
        f"1.0 {waits}, which no module handles",
        f"1.5 {asked}, and goes on; no module handles it",
    ]
    run = tale.module("cellar", "salt").delivered(salt, "cellar").at(3.0).fold()
    assert of_handler(run)[1] == f"1.5 {asked}, and goes on; cellar handles it"
    run = tale.returned(salt).say(facts.Answered(salt), facts.Dropped(taste, "any", "no need")).at(4.0).fold()
    assert of_handler(run) == [f"1.0 (2.0 s) {waits}", f"1.5 (1.5 s) {asked}, and goes on"]


def test_what_a_handler_asks_at_once_is_told_at_once() -> None:
    tale = Story().module("chef", "cook").module("cellar", "salt").at(1.0)
    cook = tale.goal("cook", "user", to="chef")
    first = [tale.at(time).received("salt", QUERY, "chef", origin=cook) for time in (1.0, 1.1, 1.2, 1.3)]
    tale.at(1.5).say(*map(facts.Awaited, first)).at(2.0).say(*map(facts.Answered, first[:3]))
    known = [one for one in told(tale.fold(), cook) if "waits" in one]
    assert known[0] == f"1.5 {WAITS} reply to salt {{5}}"  # as long as one is to come, each has its line
    assert known[1:] == [f"1.5 (0.5 s) {WAITS} reply to salt {{{one}}}" for one in (2, 3, 4)]
    last = tale.at(2.5).say(facts.Answered(first[3])).received("salt", QUERY, "chef", origin=cook)
    tale.at(3.0).say(facts.Awaited(last)).at(3.5).say(facts.Answered(last))
    lines = [one for one in told(tale.at(4.0).fold(), cook) if "its handler" in one]
    assert lines == [
        "1.0 (0.5 s) its handler asked salt {2}, salt {3}, salt {4} and 1 more, and goes on",
        f"1.5 (1.0 s) {WAITS} replies to salt {{2}}, salt {{3}}, salt {{4}} and 1 more",
        "2.5 (0.5 s) its handler asked salt {6}, and goes on",
        f"3.0 (0.5 s) {WAITS} reply to salt {{6}}",
    ]


def test_of_very_many_subtasks_a_few_waits_are_made_and_all_are_counted() -> None:
    tale = Story().module("boss", "walk").module("legs", "move").at(1.0)
    walk = tale.goal("walk", "user", to="boss", begins=True)
    moves = [tale.command("move", "boss", walk) for _ in range(1000)]
    run = tale.returned(walk).at(2.0).delivered(moves[0], "legs").at(3.0).achieved(moves[0]).at(4.0).fold()
    at = RunAt(run)
    assert reasons(at, at.tasks[walk]) == ["until move {3}, move {4}, move {5} and 996 more are achieved"]
    assert (len(waits_now(at, walk)), len(told_waits(run, run.tasks[walk], together=True))) == (4, 3)
    kept = "achieving, until move {2}, move {3}, move {4} and 997 more are achieved, 999 of them still to come"
    assert told(run, walk)[-1] == f"1.0 {kept}"
