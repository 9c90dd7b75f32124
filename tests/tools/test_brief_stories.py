"""What a story says of one wait, and how it says much in few lines."""

import msgspec
from tools.story import QUERY, Story
from tools.test_story import told

from tca_tools.history import History
from tca_wire import facts
from tca_wire.points import ROOT, TaskId
from tca_wire.vocabulary import MessageClass, Role


def test_who_waits_for_a_reply_is_told_where_the_query_is() -> None:
    tale = Story().module("chef", "cook").at(1.0)
    cook = tale.goal("cook", "user")
    taste = tale.delivered(cook, "chef").received("taste", QUERY, "chef", origin=cook, blocking=True)
    tale.queued(taste)
    salt = tale.at(1.5).received("salt", QUERY, "chef", origin=cook)
    tale.queued(salt).at(2.0)
    asked, waits = "its handler asked salt {3}", "its handler waits for the reply to taste {2}"

    def of_handler(past: History) -> list[str]:
        return [one for one in told(past, cook) if "its handler" in one]

    assert of_handler(tale.fold()) == [
        f"1.0 {waits}, which no module handles",
        f"1.5 {asked}, which no module handles, and goes on",
    ]
    past = tale.module("cellar", "salt").delivered(salt, "cellar").at(3.0).fold()
    assert of_handler(past)[1] == f"1.5 {asked}, which cellar handles, and goes on"
    past = tale.returned(salt).say(facts.Answered(salt), facts.Dropped(taste, "no need")).at(4.0).fold()
    assert of_handler(past) == [f"1.0 (2.0 s) {waits}", f"1.5 (1.5 s) {asked}, and goes on"]


def test_what_central_made_is_named_once() -> None:
    tale = Story().module("legs", "move")
    move = tale.command("move", "user")
    recover = tale.received("recover", MessageClass.EXCEPTION, "central", move, origin=ROOT)
    about = {"role": Role.EXCEPTION, "about": TaskId(move)}
    tale.entries[-1].facts[-1] = msgspec.structs.replace(tale.entries[-1].facts[-1], **about)
    assert told(tale.fold(), recover)[0] == "0.0 exception handler made by central for move {1}, under move {1}"
