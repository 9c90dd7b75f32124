"""Ends the waits of modules for handlers of messages. Sends notices when handlers come or go.

A message is handled as long as one of its handlers has a slot. ``MessageType.serving`` counts these
handlers.
"""

from collections.abc import Iterable

from tca_central.errors import RequestError
from tca_central.model.deliveries import Connection, PresenceWait, presence_size
from tca_central.outgoing.central_messages import broadcast_notice
from tca_central.state import State
from tca_wire.journal import facts
from tca_wire.messages.notices import HANDLERS_CHANGED, HandlerCount
from tca_wire.packets import headers
from tca_wire.packets.headers import Answer
from tca_wire.points import ROOT, TaskId
from tca_wire.text.measures import listed
from tca_wire.vocabulary import Refusal
from tca_wire.waits import WaitKind

MOST_AWAITED = 1000
"""The limit for messages in one wait."""


def on_wait_until_handled(
    central: State, connection: Connection, header: headers.WaitUntilHandled, _: bytes
) -> None:
    """Begin a module's wait until all messages that it needs are handled."""
    if len(header.messages) > MOST_AWAITED:
        number = f"{len(header.messages):,}"
        text = f"{number} messages in one wait: {MOST_AWAITED:,} are allowed, send several requests"
        raise RequestError(Refusal.OVERLOAD, text)
    known = central.registry.messages
    for name in header.messages:
        if name not in known:
            raise RequestError(
                Refusal.UNKNOWN, f"message '{name}' is not declared: register it first"
            )
    messages = [known[name] for name in dict.fromkeys(header.messages)]
    central.check_declared(presence_size(messages))
    if all(message.serving for message in messages):
        central.answer(connection, header.number, Answer(header.number))
        return
    wait = PresenceWait(connection, header, messages)
    central.budget.presence_bytes += wait.size
    connection.outstanding[header.number] = wait
    central.facts.append(facts.WaitBegan(*_fact_fields(wait)))
    # A *brief* wait is not checked for a deadlock: another module may still join.
    central.block(connection, header.number, header.origin, brief=True)
    if wait.promised:
        _warn_of_cycle(central, wait)


def _warn_of_cycle(central: State, newest: PresenceWait) -> None:
    """Warn modules that wait for each other, if the newest wait closes a cycle.

    The waits stay: another module may still join.
    """
    remaining = {
        wait: None for message in central.registry.messages.values() for wait in message.awaited_by
    }
    promisers: dict[str, list[PresenceWait]] = {}
    for wait in remaining:
        for name in wait.promised:
            promisers.setdefault(name, []).append(wait)
    # Keep the waits with a message that only other waits in the set promise to handle. Repeat until
    # the set no longer shrinks.
    while len(
        stuck := {wait: by for wait in remaining if (by := _promiser(wait, promisers, remaining))}
    ) < len(remaining):
        remaining = dict.fromkeys(stuck)
    cycle: dict[PresenceWait, str] = {}
    while newest in stuck and newest not in cycle:
        message, following = stuck[newest]
        module, other = newest.connection.module.name, following.connection.module.name
        cycle[newest] = f"'{module}' waits for '{message}', which '{other}' will handle"
        newest = following
    needs = "; ".join(cycle.values())
    text = f"modules require each other: {needs}: none of them starts, unless another module joins"
    for wait in cycle:
        central.notify(wait.connection, Answer(wait.number, text=text, more=True))


def _promiser(
    wait: PresenceWait, promisers: dict[str, list[PresenceWait]], waits: Iterable[PresenceWait]
) -> tuple[str, PresenceWait] | None:
    """Return a message that a wait lacks, and one of the waits that promise to handle it later.

    All waits that promise the message must be in *waits*. Return None if there is no such message.
    """
    for message in wait.messages:
        others = promisers.get(message.name, ())
        if others and not message.serving and all(other in waits for other in others):
            return message.name, others[0]
    return None


def end_presence_wait(central: State, wait: PresenceWait) -> None:
    """End a wait: all its messages are handled, or its module waits no longer."""
    wait.end()
    central.budget.presence_bytes -= wait.size
    central.facts.append(facts.WaitEnded(*_fact_fields(wait)))


def _fact_fields(wait: PresenceWait) -> tuple[str, int, TaskId, int, WaitKind, str]:
    """Return the fields of the facts that a wait began or ended."""
    names = listed([message.name for message in wait.messages])
    return wait.connection.module.name, wait.origin, ROOT, 0, WaitKind.PRESENCE, names


def publish_changes(central: State) -> None:
    """End waits and send notices for messages whose number of handlers the event has changed."""
    changed = [
        (message, before)
        for message, before in central.dispatcher.old_serving_counts.items()
        if message.serving != before
    ]
    central.dispatcher.old_serving_counts.clear()
    waits: dict[PresenceWait, None] = {}
    for message, before in changed:
        waits |= message.awaited_by
        if not (before and message.serving):
            for wait in message.awaited_by:
                wait.missing += 1 if before else -1
    for wait in [one for one in waits if not one.missing]:
        end_presence_wait(central, wait)
        del wait.connection.outstanding[wait.number]
        central.answer(wait.connection, wait.number, Answer(wait.number))
    for message, _ in changed:
        if not message.is_notice:
            broadcast_notice(central, HANDLERS_CHANGED, HandlerCount(message.name, message.serving))
