"""Questions and waits that came to nothing, questions to many: in stories, waits and on the critical path."""

import pytest
from central.player import Player
from tools.story import QUERY, THIS, Story
from tools.test_critical_path import path_of, steps_of

from tca_tools.analysis.backwards import Causes
from tca_tools.analysis.critical_path import critical_path
from tca_tools.analysis.failures import failures
from tca_tools.analysis.long_waits import long_waits as waits
from tca_tools.analysis.step_words import why_then
from tca_tools.explain.story import story as story_of
from tca_tools.explain.wait_words import in_the_end
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.fates import Fate
from tca_tools.journal.fold import History
from tca_tools.journal.whole_run import Run
from tca_tools.log.classic import classic_lines
from tca_tools.report.contents import contents
from tca_tools.stats.measure import measure
from tca_tools.tasktree_viz import words
from tca_wire.constraints import Flags, sequential_achievement
from tca_wire.journal import facts
from tca_wire.packets import headers
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import Dropping, MessageClass, Outcome, Refusal, Role
from tca_wire.waits import WaitKind


def asking() -> Run:
    """A handler asks three times, for half a second each: of one who is at work, behind that, and of nobody."""
    tale = Story().module("legs", "act").module("map", "where").module("eyes")
    act = tale.command("act", "user", to="legs")
    first = tale.received("where", QUERY, "legs", origin=act, blocking=True, to="map")
    tale.at(0.5).say(facts.Dropped(first, "any", "its sender gave up", dropping=Dropping.GIVEN_UP))
    second = tale.at(0.6).received("where", QUERY, "legs", origin=act, blocking=True)
    tale.queued(second, "map").at(1.0)
    tale.say(
        facts.Unqueued(second),
        facts.Dropped(second, "any", "its sender gave up", dropping=Dropping.GIVEN_UP, where="it is queued for map"),
    ).at(1.25)
    third = tale.received("look", QUERY, "legs", origin=act)
    tale.queued(third).at(1.5).say(facts.Awaited(third)).at(2.0)
    tale.say(
        facts.Unqueued(third),
        facts.Dropped(third, "any", "its sender gave up", dropping=Dropping.GIVEN_UP, where="no module handles it"),
    ).at(2.5)
    return tale.achieved(act).at(3.0).returned(first).fold()


def test_the_story_says_where_each_question_was() -> None:
    told = [(one.time, one.seconds, one.text) for one in story_of(asking(), 1)]
    assert told[2:6] == [
        (0.0, 0.5, "its handler waits for the reply to where {2}, and gives up: map handles it"),
        (0.6, 0.4, "its handler waits for the reply to where {3}, and gives up: it is queued for map, busy with where {2}"),
        (1.25, 0.25, "its handler asked look {4}, and goes on"),
        (1.5, 0.5, "its handler waits for the reply to look {4}, and gives up: no module handles it"),
    ]  # fmt: skip


def test_before_it_gave_up_nobody_knew_that_it_would() -> None:
    first = next(sentence for sentence in story_of(asking(), 1) if "where {2}" in sentence.text)
    assert first.known(0.25).text == "its handler waits for the reply to where {2}"


def test_the_story_of_who_asked_says_that_the_answer_was_a_failure() -> None:
    """Also where its handler copes: what it does next is done for that reason."""
    tale = Story().module("legs", "act").module("map", "where")
    act = tale.command("act", "user", to="legs")
    for is_awaited, took in ((True, 0.5), (False, 1.0)):
        where = tale.received("where", QUERY, "legs", origin=act, blocking=is_awaited, to="map")
        tale.at(took).returned(where, Outcome.FAILED)
        tale.say(facts.Failed(where, "dark", "no light\nat all"), facts.Answered(where)).at(took + 0.25)
    told = story_of(tale.achieved(act).fold(), act)
    waited, asked = (one for one in told if "where" in one.text)
    assert (waited.text, waited.seconds) == (
        "its handler waits for the reply to where {2}, which fails: dark: no light ...",
        0.5,
    )
    assert asked.text == "its handler asked where {3}, and goes on; it fails: dark: no light ..."
    assert waited.known(0.25).text == "its handler waits for the reply to where {2}"
    assert asked.known(0.8).text == "its handler asked where {3}, and goes on"


def test_the_longest_waits_say_that_they_were_in_vain() -> None:
    (replies,) = (one for one in waits(asking()) if one.kind is WaitKind.REPLY)
    assert (replies.number, round(replies.seconds, 6)) == (3, 1.4)
    assert {one.what for one in replies.longest} == {
        "for the reply to where {2}, which map handles, in vain",
        "for the reply to where {3}, which is queued for map, busy with where {2}, in vain",
        "for the reply to look {4}, which no module handles, in vain",
    }


def test_the_critical_path_goes_on_through_what_was_waited_for() -> None:
    assert path_of(asking()) == [
        ("where", "map", 0.0, 0.5), ("act", "legs", 0.5, 0.6), ("queued", "map", 0.6, 1.0),
        ("act", "legs", 1.0, 1.25), ("no handler", "", 1.25, 2.0), ("act", "legs", 2.0, 2.5),
    ]  # fmt: skip


def test_a_wait_with_a_timeout_for_a_task_that_is_still_handled_leads_into_that() -> None:
    tale = Story().module("brain", "walk").module("legs", "move")
    move = tale.command("move", "user")
    tale.at(0.25).delivered(move, "legs").at(0.5)
    walk = tale.goal("walk", "user", to="brain", begins=True)
    tale.at(0.75).say(facts.WaitBegan("brain", walk, TaskId(move), Moment.END_ACHIEVING)).at(1.0)
    tale.say(facts.WaitEnded("brain", walk, TaskId(move))).at(1.5)
    tale.returned(walk).reached(walk, *Moment).at(2.0).returned(move)
    run = tale.fold()
    assert steps_of(run, run.tasks[TaskId(walk)])[1:] == [("move", "legs", 0.25, 1.0), ("walk", "brain", 1.0, 1.5)]


def asking_all(*, answers: int = 0) -> Player:
    """A guard asks three modules how they are; the legs walk meanwhile. The first of the others have answered."""
    player = Player()
    player.module("guard", "command watch")
    player.module("arm", "multi-query status")
    player.module("head", "multi-query status")
    player.module("legs", "multi-query status", "command walk")
    player.module("user")
    player.task("user", "walk")
    watch = player.task("user", "watch", flags=Flags(0))
    player.send("guard/1", "status", origin=watch, blocking=True)
    for module in ("arm", "head")[:answers]:
        player.reply(f"{module}/1", value=1)
    return player


def past_of(player: Player) -> Run:
    return History.until(player.entries)


@pytest.mark.parametrize(
    ("answers", "who"),
    [
        (0, "arm, head and legs (queued, busy with walk {1}) have not answered"),
        (1, "head and legs (queued, busy with walk {1}) have not answered (1 of 3 has)"),
        (2, "legs (queued, busy with walk {1}) has not answered (2 of 3 have)"),
    ],
)
def test_who_has_not_answered_is_named_with_why(answers: int, who: str) -> None:
    at = RunAt(past_of(asking_all(answers=answers)))
    assert f"waits for the reply to status {{3}}, which {who}" in words.note(at, at.tasks[2])


def test_the_end_of_the_wait_is_what_the_last_of_them_does() -> None:
    at = RunAt(past_of(asking_all(answers=2)))
    assert str(in_the_end(at, at.tasks[2])) == "for walk {1}, which legs handles"


def test_who_waits_for_the_asker_is_told_too() -> None:
    player = asking_all(answers=1)
    player.reply("legs/1", value=1)  # it has walked, and is asked now
    another = player.task("user", "watch", flags=Flags(0))
    at = RunAt(past_of(player))
    assert (
        str(in_the_end(at, at.tasks[another])) == "for status {3}, which head and legs have not answered (1 of 3 has)"
    )


def test_the_story_says_it_as_long_as_it_is_so() -> None:
    player = asking_all(answers=1)
    before = player.time
    player.reply("head/1", value=1)
    player.reply("legs/1", value=1)
    player.reply("legs/1", value=1)
    run = past_of(player)

    def waiting(moment: float) -> str:
        return next(one.text for one in story_of(run, 2, moment) if "waits for" in one.text)

    assert "head and legs (queued, busy with walk {1}) have not answered" in waiting(before)
    assert waiting(run.time) == "its handler waits for the reply to status {3}"


def test_who_had_not_answered_when_it_was_given_up() -> None:
    player = asking_all(answers=1)
    player.receive("guard/1", headers.GiveUp(player.numbers["guard/1"]))
    told = [one.text for one in story_of(past_of(player), 2)]
    assert any(
        text.endswith("and gives up: head and legs (queued, busy with walk {1}) have not answered (1 of 3 has)")
        for text in told
    ), told


def test_the_story_of_a_question_that_was_given_up_tells_the_answers_there_were() -> None:
    """Its sender gets them and goes on; only what nobody answered has come to nothing."""
    player = asking_all(answers=1)
    player.fail("head/1", "no power")
    player.receive("guard/1", headers.GiveUp(player.numbers["guard/1"]))
    told = [one.text for one in story_of(past_of(player), 3)]
    assert ("its sender waits no longer: 1 of 3 had answered: arm (1)") in told
    assert not [text for text in told if "came to nothing" in text]
    player = asking_all()
    player.receive("guard/1", headers.GiveUp(player.numbers["guard/1"]))
    assert any(one.text.startswith("came to nothing: its sender gave up") for one in story_of(past_of(player), 3))


# --- link by link ----------------------------------------------------------------------------------------------------


END = Moment.END_ACHIEVING


def whys(run: Run, task: int) -> list[str]:
    return [why_then(run, step) for step in critical_path(run, Causes(run), run.tasks[task]).steps]


def one_after_the_other() -> tuple[Story, list[int]]:
    """A day, a walk and a cleaning in sequence; the walk and the cleaning are planned, the day is killed at 5.0."""
    story = Story().module("user").module("boss", "day", "walk", "clean").module("arm", "grip", "move").at(1.0)
    tasks: list[int] = []
    for name in ("day", "walk", "clean"):
        tasks.append(story.goal(name, "user", 0, *[sequential_achievement(TaskId(one), THIS) for one in tasks[-1:]]))
    day, walk, clean = tasks
    grip = story.delivered(day, "boss").reached(day, Moment.START_ACHIEVING).command("grip", "boss", day)
    story.delivered(grip, "arm").returned(day).reached(day, Moment.END_PLANNING).at(2.0)
    story.delivered(walk, "boss").returned(walk).reached(walk, Moment.END_PLANNING).at(3.0).delivered(clean, "boss")
    tasks.append(story.command("move", "boss", clean))
    story.returned(clean).reached(clean, Moment.END_PLANNING).at(5.0).returned(grip, Outcome.FAILED)
    story.say(facts.Failed(grip, "slipped", ""), facts.Unhandled(TaskId(grip)), facts.Killed(TaskId(grip), "why"))
    story.say(facts.Killed(TaskId(day), "it slipped")).reached(grip, *Moment).reached(day, *Moment)
    return story.reached(walk, Moment.START_ACHIEVING, END).reached(clean, Moment.START_ACHIEVING), tasks


LINKS = (
    "; clean {3} waited until walk {2} is achieved; walk {2} waited until day {1} is achieved; "
    "day {1} was killed: it slipped"
)


def test_what_waits_for_what_is_told_link_by_link() -> None:
    story, (_, _, clean, move) = one_after_the_other()
    story.delivered(move, "arm").at(7.0).returned(move).reached(move, END).reached(clean, END)
    assert whys(story.fold(), clean)[-1] == f"it waited until its parent clean {{3}} is being achieved{LINKS}"


def test_so_it_is_of_a_listener() -> None:
    story, (_, _, clean, move) = one_after_the_other()
    story.module("safety", "check")
    check = story.received(
        "check", MessageClass.COMMAND, "central", move, origin=0, role=Role.LISTENER, about=move, to="safety"
    )
    story.at(6.0).returned(check).reached(check, END)
    story.delivered(move, "arm").at(7.0).returned(move).reached(move, END).reached(clean, END)
    assert whys(story.fold(), clean)[-2] == (
        f"listener for move {{{move}}}, which waited until its parent clean {{3}} is being achieved{LINKS}"
    )


def given_up() -> Run:
    """*go* asks for a look, gives up after a second, then asks all, of whom the eye still looks; in vain, too."""
    story = Story().module("user").module("m", "go").module("eye", "look", "all").at(1.0)
    go = story.command("go", "user", to="m")
    look = story.at(2.0).received("look", QUERY, "m", origin=go, blocking=True, to="eye")
    story.at(3.0).say(facts.Dropped(look, "any", "its sender gave up", dropping=Dropping.GIVEN_UP)).at(4.0)
    every = story.received("all", MessageClass.MULTI_QUERY, "m", origin=go, blocking=True)
    story._next_id += 1
    story.say(facts.Queued(every + 1, every, "eye", "eye")).at(5.0).say(
        facts.Dropped(every, "any", "its sender gave up", dropping=Dropping.GIVEN_UP)
    )
    story.at(6.0).returned(go).reached(go, END).at(8.0).returned(look)
    return story.at(9.0).fold()


STILL = "look {2} was given up at 3.000 s, but eye went on with it until 8.000 s"


def test_a_question_to_many_that_is_given_up_stood_in_a_queue() -> None:
    run = given_up()
    assert path_of(run) == [
        ("go", "m", 1.0, 2.0), ("look", "eye", 2.0, 3.0), ("go", "m", 3.0, 4.0), ("queued", "eye", 4.0, 5.0),
        ("go", "m", 5.0, 6.0),
    ]  # fmt: skip
    assert any(f"for eye, busy with look {{2}}; {STILL}" in why for why in whys(run, 1))


def test_who_goes_on_with_what_was_given_up_is_named() -> None:
    told = {one.title: one for one in contents(given_up()).advice}
    for name in ("look", "all"):
        one = told[f"The reply to '{name}' is waited for in vain"]
        assert one.example.endswith(STILL)
        assert "Giving up does not end the handler: it keeps its resource" in one.remedy


# --- waits that came to nothing, or took no time ---------------------------------------------------------------------


CIRCLE = "each waits for the next, in a circle: a waits for b; b waits for a"
SLOW = [("go", "m", 0.0, 0.5), ("slow", "k", 0.5, 3.5)]


def going() -> tuple[Story, int]:
    """*go* waits three seconds for *slow*, and goes on at 3.5."""
    told = Story().module("m", "go", "back").module("n", "ask").module("k", "slow", "short")
    go = told.goal("go", "user", to="m", begins=True)
    slow = told.at(0.5).command("slow", "m", go, to="k")
    told.say(facts.WaitBegan("m", go, TaskId(slow), Moment.END_ACHIEVING)).at(3.5)
    told.achieved(slow).say(facts.WaitEnded("m", go, TaskId(slow)))
    return told, go


def short_at(told: Story, time: float, go: int) -> Run:
    """Then it commands *short*, half a second."""
    short = told.at(time).command("short", "m", go, to="k")
    told.returned(go).at(time + 0.5)
    return told.achieved(short).reached(go, Moment.END_ACHIEVING).fold()


def test_through_a_lock_that_was_wanted_in_vain() -> None:
    told, go = going()
    told.at(4.0).say(facts.Claimed(50, "n", "n", False, "m", go)).at(4.3).say(facts.ClaimEnded(50, "its time is over"))
    run = short_at(told, 4.4, go)
    last = [("go", "m", 3.5, 4.0), ("locked", "n", 4.0, 4.3), ("go", "m", 4.3, 4.4), ("short", "k", 4.4, 4.9)]
    assert path_of(run) == SLOW + last
    assert "its handler waited for the lock of n {50}, in vain" in whys(run, 1)


def test_through_a_task_that_was_waited_for_in_vain() -> None:
    told, go = going()
    never = told.at(4.0).command("never", "m", go)
    told.queued(never).say(facts.WaitBegan("m", go, TaskId(never), Moment.END_ACHIEVING)).at(4.3)
    told.say(facts.WaitEnded("m", go, TaskId(never)))
    run = short_at(told, 4.4, go)
    assert [row[:2] for row in path_of(run)][2:5] == [("go", "m"), ("no handler", ""), ("go", "m")]
    assert f"its handler waited until never {{{never}}} is achieved, in vain" in whys(run, 1)


def refused() -> Run:
    """*ask* would wait for its asker, copes, and answers after a tenth of a second."""
    told, go = going()
    return short_at(_asked(told, go), 4.2, go)


def _asked(told: Story, go: int) -> Story:
    ask = told.at(4.0).received("ask", QUERY, "m", origin=go, blocking=True, to="n")
    back = told.at(4.05).received("back", QUERY, "n", origin=ask, blocking=True)
    told.queued(back, "m").say(facts.RequestRefused("n", Refusal.DEADLOCK, CIRCLE), facts.Unqueued(back))
    told.say(facts.Dropped(back, "any", "deadlock", dropping=Dropping.DEADLOCK)).at(4.1)
    return told.returned(ask, data=-1).say(facts.Answered(ask))


def test_through_a_deadlock_that_was_refused_at_once() -> None:
    go_on = [("go", "m", 3.5, 4.0), ("ask", "n", 4.0, 4.1), ("go", "m", 4.1, 4.2), ("short", "k", 4.2, 4.7)]
    assert path_of(refused()) == SLOW + go_on


def test_a_deadlock_that_was_coped_with_is_told_with_its_circle() -> None:
    run = refused()
    (kind,) = failures(run)
    (case,) = kind.cases
    assert (kind.failure, kind.message, case.of, case.text) == ("deadlock", "ask", "ask {3}", CIRCLE)
    assert (case.fate, case.time, case.why) == (Fate.COPED, 4.05, "it was to wait for the reply to back {4}")
    (asked,) = (one for one in story_of(run, 3) if "waits" in one.text)
    assert asked.text == f"its handler waits for the reply to back {{4}}, and is refused: deadlock: {CIRCLE}"
    assert asked.seconds is None
    assert f"came to nothing: deadlock: {CIRCLE}" in [one.text for one in story_of(run, 4)]
    assert (measure(run).deadlocks, measure(run, start=4.1).deadlocks) == (1, 0)


def test_a_deadlock_of_a_program_outside_of_handlers_is_told_to_it() -> None:
    told = Story().module("user").module("k", "slow").at(1.0)
    slow = told.command("slow", "user", to="k")
    told.at(2.0).say(facts.WaitBegan("user", 0, TaskId(slow), Moment.END_ACHIEVING)).at(3.0)
    told.say(facts.RequestRefused("user", Refusal.DEADLOCK, CIRCLE), facts.WaitEnded("user", 0, TaskId(slow)))
    run = told.at(4.0).fold()
    (kind,) = failures(run)
    assert (kind.cases[0].of, kind.cases[0].fate, kind.message) == ("user", Fate.TOLD, "slow")
    assert contents(run).stories == {}


def test_a_query_that_is_dropped_from_a_queue_is_not_on_hold_in_the_classic_log() -> None:
    told, go = going()
    lines = "\n".join(classic_lines(_asked(told, go).entries))
    assert "Dropped" in lines
    assert "ON HOLD" not in lines


@pytest.mark.parametrize("looks_at", [2.5, 5.0])
def test_a_program_that_looks_at_a_result_late_had_to_wait_for_it(looks_at: float) -> None:
    """Whether it waits while the task still runs, or asks when that is over: first that, then the program."""
    told = Story().module("k", "slow").module("user").at(1.0)
    slow = told.command("slow", "user", to="k")
    waits = facts.WaitBegan("user", 0, TaskId(slow), Moment.END_ACHIEVING), facts.WaitEnded("user", 0, TaskId(slow))
    if looks_at < 3.0:
        told.at(looks_at).say(waits[0])
    told.at(3.0).achieved(slow).say(*waits[1:] * (looks_at < 3.0))
    if looks_at > 3.0:
        told.at(looks_at).say(*waits)
    other = told.at(6.0).command("slow", "user")
    run = told.acted(other, "k", 1.0).fold()
    assert path_of(run) == [("slow", "k", 1.0, 3.0), ("outside", "user", 3.0, 6.0), ("slow", "k", 6.0, 7.0)]


def test_of_a_reply_to_many_that_is_waited_for_a_copy_may_stand_in_a_queue() -> None:
    told = Story().module("m", "go").module("n", "all").at(1.0)
    go = told.command("go", "user", to="m")
    asked = told.at(2.0).received("all", MessageClass.MULTI_QUERY, "m", origin=go, blocking=True)
    run = told.say(facts.Queued(asked + 1, asked, "n", "n")).at(5.0).fold()
    assert path_of(run) == [("go", "m", 1.0, 2.0), ("queued", "n", 2.0, 5.0)]


def test_a_lock_is_waited_for_while_somebody_is_at_work_there() -> None:
    told = Story().module("m", "go").module("n", "hog").at(1.0)
    told.command("hog", "user", to="n")
    go = told.at(2.0).command("go", "user", to="m")
    told.at(3.0).say(facts.Claimed(50, "n", "n", False, "m", go))
    run = told.at(6.0).fold()
    path = critical_path(run, Causes(run), run.tasks[go])
    assert [(run.name(step.message_id), step.start, step.end) for step in path.steps] == [("hog", 1.0, 6.0)]
    assert path.because == ["the handler of go {2} waits for the lock of n {50}, busy with hog {1}"]


def test_a_wait_that_begins_just_when_the_journal_ends() -> None:
    told = Story().module("m", "go").at(1.0)
    go = told.command("go", "user", to="m")
    told.at(2.0).queued(told.received("where", QUERY, "m", origin=go, blocking=True))
    assert path_of(told.fold()) == [("go", "m", 1.0, 2.0)]


def test_a_handler_that_is_cut_off_while_it_waits_did_nothing_just_then() -> None:
    """Its module is lost while *ask* is still at work for it: that is on the path until then."""
    told, go = going()
    told.at(4.0).delivered(told.received("ask", QUERY, "m", origin=go, blocking=True), "n").at(6.0)
    told.say(facts.ModuleLeft("m", "lost"), facts.Failed(go, "module lost", ""), facts.Killed(TaskId(go), "lost"))
    run = told.reached(go, *Moment).at(7.0).fold()
    assert path_of(run) == [*SLOW, ("go", "m", 3.5, 4.0), ("ask", "n", 4.0, 6.0)]
