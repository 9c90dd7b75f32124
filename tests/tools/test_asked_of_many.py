"""A question to many: who has not answered yet is said of whoever waits for it, by a real central's journal."""

from central.player import Player

from tca_tools.run.at_time import RunAt
from tca_tools.run.fold import History
from tca_tools.run.whole_run import Run
from tca_tools.tasktree_viz import words
from tca_tools.why.story import story
from tca_tools.why.wait_words import in_the_end
from tca_wire.constraints import Flags
from tca_wire.packets import headers


def asking(*, answers: int = 0) -> Player:
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
    at = RunAt(past_of(asking()))
    assert words.note(at, at.tasks[2]).startswith(
        "waits for the reply to status {3}, which arm, head and legs (queued, busy with walk {1}) have not answered"
    )
    at = RunAt(past_of(asking(answers=1)))
    assert "status {3}, which head and legs (queued, busy with walk {1}) have not answered (1 of 3 has)" in words.note(
        at, at.tasks[2]
    )
    at = RunAt(past_of(asking(answers=2)))
    assert "status {3}, which legs (queued, busy with walk {1}) has not answered (2 of 3 have)" in words.note(
        at, at.tasks[2]
    )


def test_the_end_of_the_wait_is_what_the_last_of_them_does() -> None:
    at = RunAt(past_of(asking(answers=2)))
    assert str(in_the_end(at, at.tasks[2])) == "for walk {1}, which legs handles"


def test_who_waits_for_the_asker_is_told_too() -> None:
    player = asking(answers=1)
    player.reply("legs/1", value=1)  # it has walked, and is asked now
    another = player.task("user", "watch", flags=Flags(0))
    at = RunAt(past_of(player))
    assert (
        str(in_the_end(at, at.tasks[another])) == "for status {3}, which head and legs have not answered (1 of 3 has)"
    )


def test_the_story_says_it_as_long_as_it_is_so() -> None:
    player = asking(answers=1)
    before = player.time
    player.reply("head/1", value=1)
    player.reply("legs/1", value=1)
    player.reply("legs/1", value=1)
    run = past_of(player)

    def waiting(moment: float) -> str:
        return next(one.text for one in story(run, 2, moment) if "waits for" in one.text)

    assert "head and legs (queued, busy with walk {1}) have not answered" in waiting(before)
    assert waiting(run.time) == "its handler waits for the reply to status {3}"


def test_who_had_not_answered_when_it_was_given_up() -> None:
    player = asking(answers=1)
    player.receive("guard/1", headers.GiveUp(player.numbers["guard/1"]))
    told = [one.text for one in story(past_of(player), 2)]
    assert any(
        text.endswith("and gives up: head and legs (queued, busy with walk {1}) have not answered (1 of 3 has)")
        for text in told
    ), told


def test_the_story_of_a_question_that_was_given_up_tells_the_answers_there_were() -> None:
    """Its sender gets them and goes on; only what nobody answered has come to nothing."""
    player = asking(answers=1)
    player.fail("head/1", "no power")
    player.receive("guard/1", headers.GiveUp(player.numbers["guard/1"]))
    told = [one.text for one in story(past_of(player), 3)]
    assert ("its sender waits no longer: 1 of 3 had answered: arm (1)") in told
    assert not [text for text in told if "came to nothing" in text]
    player = asking()
    player.receive("guard/1", headers.GiveUp(player.numbers["guard/1"]))
    assert any(one.text.startswith("came to nothing: its sender gave up") for one in story(past_of(player), 3))
