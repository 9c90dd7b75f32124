"""Questions that were given up: where they were then, in the story, among the longest waits, and on the critical path."""

from tools.story import QUERY, Story
from tools.test_critical_path import path_of, steps_of

from tca_tools.analysis.long_waits import long_waits as waits
from tca_tools.run.whole_run import Run
from tca_tools.why.story import story as story_of
from tca_wire.journal import facts
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import Outcome
from tca_wire.waits import WaitKind


def asking() -> Run:
    """A handler asks three times, for half a second each: of one who is at work, behind that, and of nobody."""
    tale = Story().module("legs", "act").module("map", "where").module("eyes")
    act = tale.command("act", "user")
    tale.delivered(act, "legs")
    first = tale.received("where", QUERY, "legs", origin=act, blocking=True)
    tale.delivered(first, "map").at(0.5).say(facts.Dropped(first, "any", "its sender gave up"))
    tale.at(0.6)
    second = tale.received("where", QUERY, "legs", origin=act, blocking=True)
    tale.queued(second, "map").at(1.0)
    tale.say(
        facts.Unqueued(second), facts.Dropped(second, "any", "its sender gave up", where="it is queued for map")
    ).at(1.25)
    third = tale.received("look", QUERY, "legs", origin=act)
    tale.queued(third).at(1.5).say(facts.Awaited(third)).at(2.0)
    tale.say(facts.Unqueued(third), facts.Dropped(third, "any", "its sender gave up", where="no module handles it")).at(
        2.5
    )
    return tale.returned(act).reached(act, Moment.END_ACHIEVING).at(3.0).returned(first).fold()


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
    act = tale.command("act", "user")
    tale.delivered(act, "legs")
    for is_awaited, took in ((True, 0.5), (False, 1.0)):
        where = tale.received("where", QUERY, "legs", origin=act, blocking=is_awaited)
        tale.delivered(where, "map").at(took).returned(where, Outcome.FAILED)
        tale.say(facts.Failed(where, "dark", "no light\nat all"), facts.Answered(where)).at(took + 0.25)
    told = story_of(tale.returned(act).reached(act, Moment.END_ACHIEVING).fold(), act)
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
        ("where", "map", 0.0, 0.5),
        ("act", "legs", 0.5, 0.6),
        ("queued", "map", 0.6, 1.0),
        ("act", "legs", 1.0, 1.25),
        ("no handler", "", 1.25, 2.0),
        ("act", "legs", 2.0, 2.5),
    ]


def test_a_wait_with_a_timeout_for_a_task_that_is_still_handled_leads_into_that() -> None:
    tale = Story().module("brain", "walk").module("legs", "move")
    move = tale.command("move", "user")
    tale.at(0.25).delivered(move, "legs").at(0.5)
    walk = tale.goal("walk", "user")
    tale.delivered(walk, "brain").reached(walk, Moment.START_ACHIEVING).at(0.75)
    tale.say(facts.WaitBegan("brain", walk, TaskId(move), Moment.END_ACHIEVING)).at(1.0)
    tale.say(facts.WaitEnded("brain", walk, TaskId(move))).at(1.5)
    tale.returned(walk).reached(walk, *Moment).at(2.0).returned(move)
    run = tale.fold()
    assert steps_of(run, run.tasks[TaskId(walk)])[1:] == [("move", "legs", 0.25, 1.0), ("walk", "brain", 1.0, 1.5)]
