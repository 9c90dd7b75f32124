"""Handlers that go on with what nobody waits for any longer, and so keep others waiting. Pure."""

from collections.abc import Iterator

from tca_tools.analysis.words import moment
from tca_tools.run.at_time import RunAt
from tca_tools.run.records import Handling, Message
from tca_tools.run.whole_run import Run
from tca_wire.text.facts_in_words import GAVE_UP, place


def still_handled(at: RunAt, message_id: int, until: float) -> str:
    """``look {8} was given up at 7.000 s, but cam went on with it until 9.000 s``: of a message, and of what kept it in
    a queue at a moment, looked at when it waited no longer; "" if there is nothing of that kind.
    """
    message = at.run.messages.get(message_id)
    found = (_told(at.run, run, until) for run in _in_its_way(at, message)) if message else ()
    return next((told for told in found if told), "")


def _in_its_way(at: RunAt, message: Message) -> Iterator[Handling]:
    """The handlers that had a message, or its place in a resource."""
    copies, queueings = at.copies_of(message)
    yield from copies
    if (run := at.handling_of(message)) is not None:
        yield run
    if (own := at.queueing_of(message)) is not None:
        queueings = [own, *queueings]
    for queueing in queueings:
        if queueing.module:
            yield from at.running(queueing.module, queueing.resource)


def _told(run: Run, handling: Handling, until: float) -> str:
    message = run.messages.get(handling.message_id)
    if message is None or not str(message.was("dropped", until) or "").startswith(GAVE_UP):
        return ""
    given_up = message.written("dropped")
    if handling.end is not None and handling.end <= given_up:
        return ""
    went_on = "goes on with it" if handling.end is None else f"went on with it until {moment(handling.end)}"
    return f"{message} was given up at {moment(given_up)}, but {place(handling.module, handling.resource)} {went_on}"
