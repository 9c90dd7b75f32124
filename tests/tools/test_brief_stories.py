"""What a story says of one wait, and how it says much in few lines."""

import msgspec
from tools.story import QUERY, Story
from tools.test_story import told

from tca_tools.run.fold import History
from tca_wire.journal import facts
from tca_wire.points import ROOT, Moment, TaskId
from tca_wire.vocabulary import MessageClass, Role

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


def test_what_central_made_is_named_once() -> None:
    tale = Story().module("legs", "move")
    move = tale.command("move", "user")
    recover = tale.received("recover", MessageClass.EXCEPTION, "central", move, origin=ROOT)
    about = {"role": Role.EXCEPTION, "about": TaskId(move)}
    tale.entries[-1].facts[-1] = msgspec.structs.replace(tale.entries[-1].facts[-1], **about)
    assert told(tale.fold(), recover)[0] == "0.0 exception handler made by central for move {1}, under move {1}"


def test_of_many_that_held_a_lock_the_first_and_the_last_are_told() -> None:
    tale = Story().module("legs", "move").module("eyes", "look").at(1.0)
    look, move = tale.command("look", "user"), tale.command("move", "user")
    tale.delivered(look, "eyes")
    for time in range(1, 10):
        tale.at(float(time)).say(facts.Claimed(90 + time, "legs", "legs", False, f"user{time}", 0))
    tale.say(facts.Claimed(100, "legs", "legs", False, "eyes", look)).queued(move, "legs").say(facts.Granted(91))
    for time in range(10, 18):
        tale.at(float(time)).say(facts.ClaimEnded(81 + time, "released"), facts.Granted(82 + time))
    run = tale.at(18.0).fold()
    waits = [one for one in told(run, look) if "its handler waits" in one]
    others = "kept busy by 3 others, one after the other"
    keepers = [f"which user{number} has locked" for number in range(1, 10)]
    expected = [*keepers[:3], others, *keepers[-3:]]
    assert all(one.endswith(by) for one, by in zip(waits, expected, strict=True)), waits
    assert f"12.0 (3.0 s) queued for legs, {others}" in told(run, move)


def test_what_a_handler_asks_at_once_is_told_at_once() -> None:
    tale = Story().module("chef", "cook").module("cellar", "salt").at(1.0)
    cook = tale.goal("cook", "user")
    tale.delivered(cook, "chef")
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


def test_so_are_tasks_that_a_handler_waits_for_at_once() -> None:
    tale = Story().module("chef", "cook").module("broom", "sweep").at(1.0)
    cook = tale.goal("cook", "user")
    tale.delivered(cook, "chef")
    sweeps = [tale.command("sweep", "chef", cook) for _ in range(4)]
    until = Moment.END_ACHIEVING
    for sweep in sweeps:
        tale.say(facts.WaitBegan("chef", cook, TaskId(sweep), until))
    for sweep in sweeps:
        tale.acted(sweep, "broom", 1.0).say(facts.WaitEnded("chef", cook, TaskId(sweep)))
    text = "until sweep {2}, sweep {3}, sweep {4} and 1 more are achieved"
    assert f"1.0 (4.0 s) its handler waits {text}" in told(tale.fold(), cook)
