"""Who is killed by an exception handler is told for which failure that was called, if that is sure; and what is to be
handled again after a failure has no end yet.
"""

from collections.abc import Callable

import msgspec
import pytest
from tools.story import Story

from tca_tools.run.fold import History
from tca_tools.tasktree_viz.failing import failure_chain
from tca_tools.why.story import story as story_of
from tca_wire.journal import facts
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import MessageClass, Outcome, Role

PATIENT, TREAT, INFUSE, TRANSFER = 1, 2, 3, 4
KILLED = "was killed: transferred (by safety)"
NIL = msgspec.msgpack.encode(None)


def help_for(story: Story, failed: int, name: str, module: str = "safety") -> int:
    """An exception handler is called for a failure, and runs."""
    handler = story.received(name, MessageClass.EXCEPTION, "central", failed, origin=0)
    received = story.entries[-1].facts[-1]
    story.entries[-1].facts[-1] = msgspec.structs.replace(received, role=Role.EXCEPTION, about=failed)
    story.say(facts.Caught(TaskId(failed), TaskId(handler), TaskId(failed), 9)).delivered(handler, module)
    return handler


def treating() -> Story:
    """Of a patient {1} the treatment {2} fails, and an exception handler {4} is called; something {3} is left to do."""
    story = Story().module("ward", "treat").module("safety", "transfer").at(1.0)
    patient = story.goal("patient", "user")
    treat = story.goal("treat", "ward", patient)
    story.command("infuse", "ward", treat)
    story.delivered(treat, "ward").at(2.0).returned(treat, Outcome.FAILED).say(facts.Failed(treat, "allergy", "rash"))
    help_for(story, treat, "transfer")
    return story.at(3.0)


def killed(task: int, by: str = "safety", asker: int = TRANSFER) -> facts.Killed:
    return facts.Killed(TaskId(task), "transferred", by, asker)


def kill(story: Story, *tasks: int, by: str = "safety", asker: int = TRANSFER) -> Story:
    story.say(*(killed(task, by, asker) for task in tasks))
    story.reached(INFUSE, *Moment)
    return story.at(4.0).returned(TRANSFER).reached(TRANSFER, *Moment).at(5.0)


def told(run: History, number: int, moment: float = 9.0) -> list[tuple[float, str]]:
    return [(one.time, "  " * one.depth + one.text) for one in failure_chain(run, TaskId(number), moment)]


@pytest.mark.parametrize(("asked", "name"), [(PATIENT, "patient {1}"), (INFUSE, "infuse {3}")])
def test_who_is_killed_by_an_exception_handler_is_told_for_which_failure(asked: int, name: str) -> None:
    run = kill(treating(), PATIENT, TREAT, INFUSE).fold()
    assert told(run, asked, 2.5) == []
    assert told(run, asked) == [
        (2.0, "  treat {2} failed: allergy: rash"),
        (2.0, "  exception handler transfer {4} was called, handled by safety"),
        (3.0, f"{name} {KILLED}"),
        (3.0, f"  treat {{2}} {KILLED}"),
    ]


def test_of_a_handler_that_was_called_for_another_one_that_failed_the_first_failure_is_told() -> None:
    story = treating()
    story.returned(TRANSFER, Outcome.FAILED).say(facts.Failed(TRANSFER, "no bed", "full"))
    give_up = help_for(story, TRANSFER, "give up")
    story.at(3.5).say(*(killed(task, asker=give_up) for task in (PATIENT, TREAT)))
    run = story.at(4.0).returned(give_up).fold()
    assert [text for _, text in told(run, PATIENT)][:4] == [
        "  treat {2} failed: allergy: rash",
        "  exception handler transfer {4} was called, handled by safety: recovering",
        "    transfer {4} failed: no bed: full",
        "    exception handler give up {5} was called, handled by safety: achieving",
    ]


def of_another_module() -> Story:
    """Somebody else kills the patient while the exception handler runs."""
    return kill(treating(), PATIENT, TREAT, INFUSE, by="ward", asker=0)


def of_code_outside() -> Story:
    """The module kills it, and not in the exception handler."""
    return kill(treating(), PATIENT, TREAT, INFUSE, asker=0)


@pytest.mark.parametrize("tell", [of_another_module, of_code_outside])
def test_what_no_exception_handler_asked_for_was_for_no_failure(tell: Callable[[], Story]) -> None:
    assert told(tell().fold(), INFUSE) == []


def of_two_handlers() -> Story:
    """Two exception handlers of the module run."""
    story = treating()
    other = story.goal("visit", "user")
    story.say(facts.Failed(other, "lost", ""))
    help_for(story, other, "call")
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


FIRST = [
    (2.0, "treat {2} failed: allergy: rash"),
    (2.0, "exception handler transfer {4} was called, handled by safety"),
]
AGAIN = (3.0, "treat {2} is to be handled again (retried by safety)")


@pytest.mark.parametrize("moment", [3.0, 3.5, 4.5])
def test_what_has_not_been_tried_again_has_no_end(moment: float) -> None:
    assert told(retrying().fold(), TREAT, moment) == [*FIRST, AGAIN]


def test_a_retry_is_a_step_from_one_failure_to_the_next() -> None:
    failed = [(5.0, "treat {2} failed: allergy: itch"), (5.0, "treat {2}: nobody dealt with its failure")]
    assert told(retrying().fold(), TREAT) == [*FIRST, AGAIN, *failed]


def test_what_succeeds_when_it_is_tried_again_is_achieved_after_all() -> None:
    story = treating().say(facts.Retried(TaskId(TREAT), b"", "safety")).returned(TRANSFER).reached(TRANSFER, *Moment)
    run = story.at(4.0).delivered(TREAT, "ward").at(5.0).returned(TREAT).reached(TREAT, *Moment).fold()
    assert told(run, TREAT) == [*FIRST, AGAIN, (5.0, "treat {2}: achieved after all")]


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
