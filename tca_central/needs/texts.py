"""Answers for modules that give up a wait, or whose requests are refused: the waits in words."""

from tca_central.model.deliveries import (
    Connection,
    Delivery,
    MessageType,
    ModuleClaim,
    ModuleResource,
)
from tca_central.needs.graph import Freeing, Granting, TurnAt, Waiting
from tca_central.needs.waits import replies_to, wait_for_resource, waits_of
from tca_central.order import dispatcher
from tca_central.order.cycles import Place
from tca_central.state import Collector, State, TaskWait
from tca_wire.packets.headers import Answer
from tca_wire.text import waits_in_words as words
from tca_wire.text.measures import counted, numbered
from tca_wire.vocabulary import Outcome
from tca_wire.waits import WaitFor, WaitKind

_FAILURES = 20
"""Failures of a multi-query that are listed one by one."""


AnswerWithBody = tuple[Answer, bytes]


def end_of_wait(
    central: State, connection: Connection, number: int, answer_to: int
) -> AnswerWithBody:
    """Return the answer for a waiter that gives up. Its text says why there was no answer before.

    For a multi-query the text contains the failures so far.
    """
    due, text = connection.outstanding.get(number), ""
    if isinstance(due, Collector):
        return end_of_multi_query(central, due, answer_to)
    if isinstance(due, TaskWait) and (task := central.tree.tasks.get(due.task_id)) is not None:
        waits = waits_of(central, Place(task, due.moment))
        text = f"it waits {words.several_in_words(waits)}" if waits else ""
    if isinstance(due, Delivery):
        (reply,) = waits_of(central, Waiting(connection, number))
        text = words.whereabouts(reply)
    return Answer(answer_to, text=text), b""


def end_of_multi_query(central: State, collector: Collector, number: int) -> AnswerWithBody:
    """Return the final answer of a multi-query: "done", or the first failure if no module replied.

    The text contains the first ``_FAILURES`` failures, and the number of further ones.
    """
    answer, body = collector.end or (Answer(number), b"")
    text = _why_not_replied(central, collector)
    if answer.outcome is Outcome.DONE:
        return Answer(number, text=text), b""
    trace = answer.text.partition("\n")[2]
    text = f"{text}\n{trace}" if trace else text
    return Answer(number, answer.outcome, answer.failure, text), body


def _why_not_replied(central: State, collector: Collector) -> str:
    """Return which modules have not replied to a multi-query, and why; "" if all have."""
    reports = collector.failures[:_FAILURES]
    if more := len(collector.failures) - len(reports):
        reports.append(f"and {more} more")
    if collector.pending:
        reports.append(words.not_answered(replies_to(central, collector)))
    text, end = "; ".join(reports), collector.end
    has_replies = end is not None and end[0].outcome is Outcome.DONE
    return text if has_replies or not text else f"no module replied: {text}"


def why_not_granted(central: State, claim: ModuleClaim) -> str:
    """Return why a claim is not granted yet."""
    wait = wait_for_resource(central, claim.resource, Granting(claim))
    return f"it waits {words.in_words(wait)}"


def why_full(central: State, message: MessageType, *targets: ModuleResource) -> str:
    """Return why the queues for a message are full. With *targets*, these are the only queues."""
    if not targets and not message.handlers:
        number, admitted = len(message.waiting), "no more"
        first = next(iter(message.waiting.values()), None)
        wait = WaitFor(WaitKind.HANDLER, name=message.name)
    else:
        resource, *others = targets or message.candidates
        number, admitted = resource.waiting, "only tasks"
        first = resource.first_message()
        node = TurnAt(first, resource) if first is not None else Freeing(resource)
        wait = wait_for_resource(central, resource, node, len(others))
    text = f"{counted(number, 'message')} wait{'s' * (number == 1)} {words.in_words(wait)}"
    if first is not None:
        text += f", {numbered(first.message.name, first.message_id)} first in line"
    return f"{text}; from {dispatcher.QUEUE_LIMIT:,} on {admitted} are let in"
