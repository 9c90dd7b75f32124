"""Answers for those that stop waiting, or cannot begin to: waits in words."""

from msgspec.structs import replace

from tca_central.model.deliveries import Connection, Delivery, MessageType, ModuleResource
from tca_central.model.resources import Claim
from tca_central.needs.graph import Freeing, Granting, TurnAt, Waiting
from tca_central.needs.waits import of_resource, replies_to, waits_of
from tca_central.order import dispatcher
from tca_central.order.cycles import Place
from tca_central.state import Collector, State, TaskWait
from tca_wire.packets.headers import Answer
from tca_wire.text.measures import counted, numbered
from tca_wire.text.waits_in_words import in_words, not_answered, several_in_words, whereabouts
from tca_wire.vocabulary import Outcome
from tca_wire.waits import WaitFor, WaitKind

_FAILURES = 20
"""The failures of a multi-query that are listed one by one."""


def end_of_wait(central: State, connection: Connection, number: int, answer_to: int) -> tuple[Answer, bytes]:
    """The answer for a waiter that gives up: why there was none yet and, of a multi-query, the failures so far."""
    match connection.outstanding.get(number):
        case Collector() as collector:
            return end_of_multi_query(central, collector, answer_to)
        case TaskWait() as wait if (task := central.tree.tasks.get(wait.task_id)) is not None:
            waits = waits_of(central, Place(task, wait.moment))
            return Answer(answer_to, text=f"it waits {several_in_words(waits)}" if waits else ""), b""
        case Delivery():
            (reply,) = waits_of(central, Waiting(connection, number))
            return Answer(answer_to, text=whereabouts(reply)), b""
    return Answer(answer_to), b""


def end_of_multi_query(central: State, collector: Collector, number: int) -> tuple[Answer, bytes]:
    """The end of a multi-query: done, or the first failure if nobody replied; the text names all others."""
    answer, body = collector.end or (Answer(number), b"")
    text = _why_not_replied(central, collector)
    if answer.outcome is Outcome.DONE:
        return Answer(number, text=text), b""
    trace = answer.text.partition("\n")[2]
    return Answer(number, answer.outcome, answer.failure, f"{text}\n{trace}" if trace else text), body


def _why_not_replied(central: State, collector: Collector) -> str:
    """The modules asked by a multi-query that have not replied, and why; "" if all have."""
    failures = collector.failures
    told = failures[:_FAILURES]
    told += [f"and {len(failures) - _FAILURES} more"] if len(failures) > _FAILURES else []
    told += [not_answered(replies_to(central, collector))] if collector.pending else []
    text = "; ".join(told)
    has_replies = collector.end is not None and collector.end[0].outcome is Outcome.DONE
    return text if has_replies or not text else f"nobody replied: {text}"


def why_not_granted(central: State, claim: Claim[Connection]) -> str:
    """The reason why a claim is not granted yet."""
    return f"it waits {in_words(of_resource(central, claim.resource, Granting(claim)))}"


def why_full(central: State, message: MessageType, *targets: ModuleResource) -> str:
    """The reason why no more messages of a type (for *targets* only) are let into a queue."""
    if not targets and not message.handlers:
        number, first, who = len(message.waiting), next(iter(message.waiting.values()), None), "no more"
        wait = WaitFor(WaitKind.HANDLER, name=message.name)
    else:
        resource, *others = targets or message.candidates
        number, first, who = resource.waiting, resource.first_message(), "only tasks"
        (wait,) = waits_of(central, TurnAt(first, resource) if first is not None else Freeing(resource))
        wait = replace(wait, more=len(others))
    in_line = f", {numbered(first.message.name, first.message_id)} first in line" if first is not None else ""
    waiting = f"{counted(number, 'message')} wait{'s' * (number == 1)} {in_words(wait)}"
    return f"{waiting}{in_line}; from {dispatcher.QUEUE_LIMIT:,} on {who} are let in"
