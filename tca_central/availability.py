"""Which messages are handled: who waits until they are, and who is told when that changes.

A message is handled as long as a handler of it has a slot to be called in; ``MessageType.serving`` counts those.
"""

from collections.abc import Iterable

from tca_central import notices
from tca_central.errors import RequestError
from tca_central.registry import Connection, MessageType
from tca_central.state import State
from tca_wire import headers
from tca_wire.headers import Answer
from tca_wire.notices import HANDLERS_CHANGED, HandlerCount
from tca_wire.vocabulary import Refusal

MOST_AWAITED = 1000
"""Messages in one request."""


class HandledWait:
    """A connection waits until each of some messages is handled, all at the same time."""

    __slots__ = ("connection", "messages", "missing", "number")

    def __init__(self, connection: Connection, number: int, messages: Iterable[MessageType]) -> None:
        self.connection, self.number = connection, number
        self.messages = tuple(messages)
        self.missing = sum(not message.serving for message in self.messages)  #: number of those that nobody handles
        for message in self.messages:
            message.awaited_by[self] = None

    def end(self) -> None:
        """Nobody waits any more."""
        for message in self.messages:
            del message.awaited_by[self]


def on_wait_until_handled(central: State, connection: Connection, header: headers.WaitUntilHandled, _: bytes) -> None:
    """A module waits until somebody handles all messages that it needs."""
    if not header.number:
        raise RequestError(Refusal.PROTOCOL, "a wait until messages are handled needs a request number")
    if len(header.messages) > MOST_AWAITED:
        text = f"{len(header.messages)} messages in one wait: {MOST_AWAITED} are allowed, send several requests"
        raise RequestError(Refusal.OVERLOAD, text)
    known = central.registry.messages
    for name in header.messages:
        if name not in known:
            raise RequestError(Refusal.UNKNOWN, f"nobody has declared message '{name}': register it first")
    wait = HandledWait(connection, header.number, [known[name] for name in dict.fromkeys(header.messages)])
    connection.outstanding[header.number] = wait
    _answer_if_over(central, wait)


def _answer_if_over(central: State, wait: HandledWait) -> None:
    if not wait.missing:
        wait.end()
        del wait.connection.outstanding[wait.number]
        central.send(wait.connection, wait.number, Answer(wait.number))


def tell_changes(central: State) -> None:
    """Tell whoever wants to know which messages are handled by more or fewer than before the event."""
    changed = [(message, before) for message, before in central.dispatcher.changed.items() if message.serving != before]
    central.dispatcher.changed.clear()
    waits: dict[HandledWait, None] = {}
    for message, before in changed:
        waits |= message.awaited_by
        if not (before and message.serving):
            for wait in message.awaited_by:
                wait.missing += 1 if before else -1
    for wait in waits:
        _answer_if_over(central, wait)
    for message, _ in changed:
        if not message.is_notice:
            notices.tell(central, HANDLERS_CHANGED, HandlerCount(message.name, message.serving))
