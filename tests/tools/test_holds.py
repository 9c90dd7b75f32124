"""What keeps a task that a wiretap, a handler that ignores a kill, or an answer that does not come holds up; and what is
to come: told in rows and stories alike.
"""

from central.player import Player
from tools.story import QUERY, THIS, Story

from tca_tools.analysis.failures import failures
from tca_tools.analysis.long_waits import long_waits as waits
from tca_tools.run.at_time import RunAt
from tca_tools.run.fates import Fate
from tca_tools.run.fold import History
from tca_tools.run.records import State
from tca_tools.run.selection import waited_for
from tca_tools.tasktree_viz.failing import failure_chain
from tca_tools.tasktree_viz.words import note
from tca_tools.why.story import story
from tca_wire.constraints import sequential_achievement
from tca_wire.journal import facts
from tca_wire.packets import headers
from tca_wire.packets.parts import Attachment
from tca_wire.points import ROOT, Moment, Point, TaskId
from tca_wire.vocabulary import Condition, MessageClass, Scope


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
    assert history.tasks[move].state is State.HELD
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
    assert history.tasks[move].state is State.ENDING
    assert noted(history, move) == "killed: too slow (by user); waits until its handler returns, for 29 s"
    player.reply("legs/1")
    history = folded(player)
    end = history.tasks[move].reached[Moment.END_ACHIEVING]
    assert history.tasks[move].states[-1] == (end, State.KILLED)
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
    assert tale.fold().tasks[move].state is State.HELD
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


def test_a_row_tells_since_when_its_cause_is_the_cause() -> None:
    story, (_, second, third, last) = queue_of_three()
    run = story.fold()
    told = [note(at := RunAt(run, time), at.tasks[last]) for time in (1.5, 4.0, 7.0)]
    assert told == [
        "waits for legs, busy with move {1}, for 500 ms",
        f"waits for legs, busy with move {{{second}}}, for 2 s (3 s in all)",
        f"waits for legs, busy with move {{{third}}}, for 2 s (6 s in all)",
    ]


def test_a_report_names_all_that_a_message_waited_for() -> None:
    story, (first, second, third, last) = queue_of_three()
    (queued,) = [one for kind in waits(story.fold()) for one in kind.longest if one.who == f"move {{{last}}}"]
    parts = [f"busy with move {{{one}}} ({length} s)" for one, length in ((first, 1), (second, 3), (third, 2))]
    assert queued.what == f"for legs, {'; '.join(parts)}"


def test_the_chart_of_a_story_has_all_that_a_task_waited_for() -> None:
    story, (*others, last) = queue_of_three()
    assert waited_for(story.fold(), TaskId(last), {last}) == set(others)
