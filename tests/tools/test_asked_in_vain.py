"""Questions that were given up, and questions to many: where they are, in stories, waits and on the critical path."""

from central.player import Player
from tools.story import QUERY, Story
from tools.test_critical_path import path_of, steps_of

from tca_tools.analysis.long_waits import long_waits as waits
from tca_tools.run.at_time import RunAt
from tca_tools.run.fold import History
from tca_tools.run.whole_run import Run
from tca_tools.tasktree_viz import words
from tca_tools.why.story import story as story_of
from tca_tools.why.wait_words import in_the_end
from tca_wire.constraints import Flags
from tca_wire.journal import facts
from tca_wire.packets import headers
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import Outcome
from tca_wire.waits import WaitKind


def asking() -> Run:
    """A handler asks three times, for half a second each: of one who is at work, behind that, and of nobody."""
    tale = Story().module("legs", "act").module("map", "where").module("eyes")
    act = tale.command("act", "user", to="legs")
    first = tale.received("where", QUERY, "legs", origin=act, blocking=True, to="map")
    tale.at(0.5).say(facts.Dropped(first, "any", "its sender gave up"))
    second = tale.at(0.6).received("where", QUERY, "legs", origin=act, blocking=True)
    tale.queued(second, "map").at(1.0)
    tale.say(
        facts.Unqueued(second), facts.Dropped(second, "any", "its sender gave up", where="it is queued for map")
    ).at(1.25)
    third = tale.received("look", QUERY, "legs", origin=act)
    tale.queued(third).at(1.5).say(facts.Awaited(third)).at(2.0)
    tale.say(facts.Unqueued(third), facts.Dropped(third, "any", "its sender gave up", where="no module handles it")).at(
        2.5
    )
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


def test_who_has_not_answered_is_named_with_why() -> None:
    at = RunAt(past_of(asking_all()))
    assert words.note(at, at.tasks[2]).startswith(
        "waits for the reply to status {3}, which arm, head and legs (queued, busy with walk {1}) have not answered"
    )
    at = RunAt(past_of(asking_all(answers=1)))
    assert "status {3}, which head and legs (queued, busy with walk {1}) have not answered (1 of 3 has)" in words.note(
        at, at.tasks[2]
    )
    at = RunAt(past_of(asking_all(answers=2)))
    assert "status {3}, which legs (queued, busy with walk {1}) has not answered (2 of 3 have)" in words.note(
        at, at.tasks[2]
    )


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
