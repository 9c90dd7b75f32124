"""A failure, step by step: who was killed for it, what a deadline ran out on, and who could not decide."""

from collections.abc import Callable

import msgspec
import pytest
from central.player import Player
from tools.runs import OPENED, checked, played
from tools.story import Story

from tca_tools.analysis.failures import failures
from tca_tools.check import rules
from tca_tools.explain.story import story as story_of
from tca_tools.journal.fates import Fate
from tca_tools.journal.fold import History
from tca_tools.tasktree_viz.failing import failure_chain
from tca_tools.tasktree_viz.told import story_lines
from tca_wire.constraints import Flags
from tca_wire.journal import facts
from tca_wire.packets import headers
from tca_wire.points import ROOT, Moment, TaskId
from tca_wire.vocabulary import Outcome

PATIENT, TREAT, INFUSE, TRANSFER = 1, 2, 3, 4
KILLED = "was killed: transferred (by safety)"
NIL = msgspec.msgpack.encode(None)


def treating() -> Story:
    """Of a patient {1} the treatment {2} fails, and an exception handler {4} is called; something {3} is left to do."""
    story = Story().module("ward", "treat").module("safety", "transfer").at(1.0)
    patient = story.goal("patient", "user")
    treat = story.goal("treat", "ward", patient)
    story.command("infuse", "ward", treat)
    story.delivered(treat, "ward").at(2.0).failed(treat, "allergy", "rash")
    story.rescued(treat, "transfer", "safety")
    return story.at(3.0)


def killed(task: int, by: str = "safety", asker: int = TRANSFER) -> facts.Killed:
    return facts.Killed(TaskId(task), "transferred", by, asker)


def kill(story: Story, *tasks: int, by: str = "safety", asker: int = TRANSFER) -> Story:
    story.say(*(killed(task, by, asker) for task in tasks)).reached(INFUSE, *Moment)
    return story.at(4.0).returned(TRANSFER).reached(TRANSFER, *Moment).at(5.0)


def told(run: History, number: int, moment: float = 9.0) -> list[tuple[float, str]]:
    return [(one.time, "  " * one.depth + one.text) for one in failure_chain(run, TaskId(number), moment)]


@pytest.mark.parametrize(("asked", "name"), [(PATIENT, "patient {1}"), (INFUSE, "infuse {3}")])
def test_who_is_killed_by_an_exception_handler_is_told_for_which_failure(asked: int, name: str) -> None:
    run = kill(treating(), PATIENT, TREAT, INFUSE).fold()
    assert told(run, asked, 2.5) == []
    assert told(run, asked) == [
        (2.0, "  treat {2} failed: allergy: rash"),
        (2.0, "  exception handler transfer {4} was called in safety"),
        (3.0, f"{name} {KILLED}"),
        (3.0, f"  treat {{2}} {KILLED}"),
    ]


def test_of_a_handler_that_was_called_for_another_one_that_failed_the_first_failure_is_told() -> None:
    story = treating()
    story.failed(TRANSFER, "no bed", "full")
    give_up = story.rescued(TRANSFER, "give up", "safety")
    story.at(3.5).say(*(killed(task, asker=give_up) for task in (PATIENT, TREAT)))
    run = story.at(4.0).returned(give_up).fold()
    assert [text for _, text in told(run, PATIENT)][:4] == [
        "  treat {2} failed: allergy: rash",
        "  exception handler transfer {4} was called in safety: recovering",
        "    transfer {4} failed: no bed: full",
        "    exception handler give up {5} was called in safety: achieving",
    ]


@pytest.mark.parametrize("by", ["ward", "safety"])
def test_what_no_exception_handler_asked_for_was_for_no_failure(by: str) -> None:
    assert told(kill(treating(), PATIENT, TREAT, INFUSE, by=by, asker=0).fold(), INFUSE) == []


def of_two_handlers() -> Story:
    """Two exception handlers of the module run."""
    story = treating()
    other = story.goal("visit", "user")
    story.say(facts.Failed(other, "lost", ""))
    story.rescued(other, "call", "safety")
    return kill(story.at(3.5), PATIENT, TREAT, INFUSE)


def of_a_late_kill() -> Story:
    """The exception handler has planned it, and returned."""
    story = treating().returned(TRANSFER).reached(TRANSFER, *Moment).at(3.5)
    return story.say(*(killed(task) for task in (PATIENT, TREAT, INFUSE))).reached(INFUSE, *Moment).at(4.0)


@pytest.mark.parametrize("tell", [of_two_handlers, of_a_late_kill])
def test_the_exception_handler_that_asked_is_known(tell: Callable[[], Story]) -> None:
    assert told(tell().fold(), INFUSE)[0] == (2.0, "  treat {2} failed: allergy: rash")


def retrying() -> Story:
    """The treatment fails, is to be handled again, and fails once more."""
    story = treating().say(facts.Retried(TaskId(TREAT), b"", "safety")).returned(TRANSFER).reached(TRANSFER, *Moment)
    story.at(4.0).delivered(TREAT, "ward").at(5.0).returned(TREAT, Outcome.FAILED)
    return story.say(facts.Failed(TREAT, "allergy", "itch"), facts.Unhandled(TaskId(TREAT))).reached(TREAT, *Moment)


FIRST = [(2.0, "treat {2} failed: allergy: rash"), (2.0, "exception handler transfer {4} was called in safety")]
AGAIN = (3.0, "treat {2} is to be handled again (retried by safety)")


def test_a_retry_is_a_step_from_one_failure_to_the_next_and_has_no_end_before() -> None:
    run = retrying().fold()
    failed = [(5.0, "treat {2} failed: allergy: itch"), (5.0, "treat {2}: nobody dealt with its failure")]
    assert told(run, TREAT) == [*FIRST, AGAIN, *failed]
    assert told(run, TREAT, 3.0) == told(run, TREAT, 4.5) == [*FIRST, AGAIN]


def test_who_is_killed_before_it_is_tried_again_was_killed() -> None:
    story = treating().say(facts.Retried(TaskId(TREAT), b"", "safety")).returned(TRANSFER).reached(TRANSFER, *Moment)
    run = story.at(4.0).say(facts.Killed(TaskId(TREAT), "enough", "user")).reached(TREAT, *Moment).fold()
    assert told(run, TREAT) == [*FIRST, AGAIN, (4.0, "treat {2} was killed: enough (by user)")]


@pytest.mark.parametrize(("data", "said"), [(b"", []), (NIL, []), (b"\x07", ["the failure's data: 7"])])
def test_of_a_failure_without_data_no_data_is_told(data: bytes, said: list[str]) -> None:
    story = Story().at(1.0)
    walk = story.goal("walk", "user")
    run = story.at(2.0).say(facts.Failed(walk, "slipped", "by hand", body=data)).fold()
    assert [one.text for one in story_of(run, walk) if "data" in one.text] == said


def playing() -> Player:
    player = Player()
    player.module("baker", "goal bake")
    player.module("oven", "command heat")
    player.module("user")
    return player


def steps(player: Player, number: int, moment: float | None = None) -> list[str]:
    run = History.until(player.entries)
    links = failure_chain(run, TaskId(number), run.time if moment is None else moment)
    return ["  " * one.depth + one.text for one in links]


def test_who_handled_what_was_waited_for_when_time_ran_out() -> None:
    player = playing()
    bake = player.task("user", "bake", deadline=20.0)
    player.task("baker/1", "heat", under=bake, flags=Flags(0))
    player.reply("baker/1")
    player.receive("user", headers.Suspend(player.number("user"), TaskId(bake)))
    player.tick(2.0)
    player.receive("user", headers.Suspend(player.number("user"), TaskId(bake), resume=True))
    before = player.time
    player.tick(30.0)
    assert steps(player, bake)[:3] == [
        "  heat {2} was being handled by oven, for 35 s when time ran out",
        "bake {1} was suspended by user, for 3 s",
        "bake {1} waited until heat {2} is achieved, for 30 s",
    ]
    assert steps(player, bake, before) == [], "nobody knew that time would run out"


def test_who_had_locked_what_was_waited_for() -> None:
    player = playing()
    player.receive("user", headers.Lock(player.number("user"), "oven"))
    heat = player.task("user", "heat", deadline=20.0)
    player.tick(30.0)
    assert steps(player, heat)[:2] == [
        "  user had the lock of oven {1}, for 31 s when time ran out",
        "heat {2} waited for oven, which user has locked, for 30 s",
    ]


def test_its_own_handler_was_at_it() -> None:
    player = playing()
    bake = player.task("user", "bake", deadline=20.0)
    player.tick(30.0)
    assert steps(player, bake)[0] == "bake {1} was being handled by baker, for 30 s when time ran out"


def test_a_failure_that_somebody_further_out_dealt_with_was_overcome() -> None:
    cases = {
        kind.failure: kind.cases[0]
        for kind in failures(History.until(played("failures_of_exception_handlers_in_one_another").entries))
    }
    assert {name: case.fate for name, case in cases.items()} == {
        "slip": Fate.DEALT_WITH, "handler error": Fate.REPLACED, "module lost": Fate.REPLACED,
    }  # fmt: skip
    assert cases["slip"].called == ["recover {5} was called in expert: failed", "report {7} was called in office"]


def test_where_nobody_could_decide_the_story_leads_to_the_first_failure_and_from_there_to_the_others() -> None:
    lines = list(story_lines(History.until(played("failures_that_nobody_could_decide_about").entries), TaskId(3), 200))
    told = [line[11:] for line in lines[lines.index("its failure, step by step:") + 1 :]]
    assert [line for line in told if " failed: " in line] == [
        "  move {4} failed: slip: why",
        "    recover {5} failed: module lost: module 'expert' was lost: its connection closed",
        "    report {6} failed: handler error: why",
    ]


@pytest.mark.parametrize("undecided", [ROOT, 4, 6])
def test_an_exception_handler_that_could_not_decide_must_be_the_nearest_and_end(undecided: int) -> None:
    """Task 5 is that of the exception handler that fails, 4 the one that it deals with, 6 another exception handler."""
    entries = [OPENED, *played("failures_that_nobody_could_decide_about").entries]
    assert checked(entries) == []
    first = next(one for one in entries if any(isinstance(fact, facts.Unhandled) for fact in one.facts))
    for place, fact in enumerate(first.facts):
        if isinstance(fact, facts.Unhandled):
            first.facts[place] = msgspec.structs.replace(fact, undecided=TaskId(undecided))
    assert rules.CAUGHT.text in {violation.rule for violation in checked(entries)}
