"""Handlers that go on with what nobody waits for any longer, and so keep others waiting. Pure."""

from collections.abc import Iterator
from math import nextafter

from tca_tools.run.at_time import RunAt
from tca_tools.run.records import Handling, Message
from tca_tools.run.whole_run import Run
from tca_wire.text.facts_in_words import place
from tca_wire.text.measures import run_time


def still_handled_in_words(run: Run, message_id: int, until: float) -> str:
    """``; look {8} was given up at 7.000 s, but cam went on with it until 9.000 s``: of a message, and of what kept it
    in a queue, looked at when it waited no longer; "" if there is nothing of that kind.
    """
    message, at = run.messages.get(message_id), RunAt(run, nextafter(until, 0.0))
    found = (_told(run, one, until) for one in _in_its_way(at, message)) if message else ()
    return next((f"; {told}" for told in found if told), "")


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
    if message is None or not message.was_given_up or message.written("dropped") > until:
        return ""
    given_up = message.written("dropped")
    if handling.end is not None and handling.end <= given_up:
        return ""
    went_on = "goes on with it" if handling.end is None else f"went on with it until {run_time(handling.end)}"
    return f"{message} was given up at {run_time(given_up)}, but {place(handling.module, handling.resource)} {went_on}"
