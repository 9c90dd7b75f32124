"""Predicates of messages: from declarations, as in ``begun(MOVE_LEG, 3)``, or from text.

The grammar::

    P         STATE of MESSAGE [with FIELD=VALUE, ...]
              MESSAGE STATE [with FIELD=VALUE, ...]
              handled by MODULE [with FIELD=VALUE, ...]
    MESSAGE   a message's name, or anything; in quotes if it contains words of the grammar
    STATE     begun, handled, planned ahead, ...: see STATES
    FIELD     a field of its data: see field_values.py
"""

from collections.abc import Callable, Sequence
from typing import Any, Protocol

from msgspec import UNSET

from tca_tools.properties.field_values import split_data, unquoted
from tca_tools.properties.world import BadProperty, MessageView
from tca_wire.messages.declarations import Message
from tca_wire.text.nearest import did_you_mean

ANYTHING = "anything"


class NamedPredicate:
    """A predicate with words, and with the name of a message or module ("": any)."""

    def __init__(self, words: str, *, message: str = "", module: str = "") -> None:
        self.words = words
        self.message = message
        self.module = module

    def __call__(self, world: Any) -> list[Any]:
        """Return the messages for which it is true."""
        raise NotImplementedError


class DataTest(Protocol):
    """A condition on a message's data."""

    def fits(self, message: MessageView) -> bool:
        """Whether a message has such data."""


class OfMessages(NamedPredicate):
    """The predicate of messages in a state, with a name, a handling module and data."""

    def __init__(
        self,
        words: str,
        state: "MessageState",
        *,
        message: str = "",
        module: str = "",
        data: Sequence[DataTest] = (),
        is_typed: bool = False,
    ) -> None:
        super().__init__(words + _with(data), message=message, module=module)
        self.data = data
        self.is_typed = is_typed  #: whether it comes from a text, so that its names are checked
        self.makes_room = state.makes_room
        self._is_in_state = state.test

    @property
    def subject(self) -> str:
        """The message and its data in words."""
        return (self.message or ANYTHING) + _with(self.data)

    def is_about(self, message: MessageView) -> bool:
        """Whether it is about a message, in any state."""
        return self.message in ("", message.message) and all(
            [one.fits(message) for one in self.data]  # noqa: C419 - each test records its data
        )

    def is_in_state(self, message: MessageView) -> bool:
        """Whether a message is in the state, with any name and data."""
        return self._is_in_state(message) and self.module in ("", message.module)

    def __call__(self, world: Any) -> list[Any]:
        """Return the messages under way for which it is true."""
        return [one for one in world.messages if self.is_in_state(one) and self.is_about(one)]


def _with(data: Sequence[DataTest]) -> str:
    return f" with {', '.join(map(str, data))}" if data else ""


class MessageState:
    """A state of messages. Call it with a declaration, and perhaps data, to get a predicate."""

    def __init__(
        self, words: str, test: Callable[[Any], bool], meaning: str, *, makes_room: bool = False
    ) -> None:
        self.words, self.test, self.meaning = words, test, meaning
        self.__doc__ = (
            f"The predicate of messages, with *data* if it is given, in a state: {meaning}."
        )
        self.makes_room = makes_room
        """Whether ``at_most`` ignores messages that ended with the last event."""

    def __call__(self, message: Message[Any, Any], data: Any = UNSET) -> OfMessages:
        """Return the predicate of messages in this state.

        Args:
            message: the declaration of the messages.
            data: the data that they must equal; any by default.

        Raises:
            BadProperty: *message* is not a declaration.
        """
        if not isinstance(message, Message):
            raise BadProperty(
                f"{self.words.replace(' ', '_')}() needs the declaration of a message "
                f"(Goal, Command, ...), not {message!r:.60}"
            )
        name = message.name
        return OfMessages(
            f"{name} {self.words}", self, message=name, data=() if data is UNSET else [_Equal(data)]
        )


class _Equal:
    """The data must equal a Python value."""

    def __init__(self, value: Any) -> None:
        self._value = value

    def __str__(self) -> str:
        return f"data={self._value!r}"

    def fits(self, message: MessageView) -> bool:
        """Whether a message has such data."""
        return bool(message.data == self._value)


sent = MessageState("sent", lambda one: one.is_new, "it was sent with the last event")
begun = MessageState(
    "begun", lambda one: one.is_begun, "a handler was given it, now or before", makes_room=True
)
handled = MessageState("handled", lambda one: one.is_handled, "a handler has it")
queued = MessageState("queued", lambda one: one.is_queued, "it waits for a resource or a handler")
planned = MessageState(
    "planned",
    lambda one: one.is_planned,
    "it was expanded, with all its descendants",
    makes_room=True,
)
planned_ahead = MessageState(
    "planned ahead",
    lambda one: one.is_planned_ahead,
    "a handler was given it, but it may not be achieved yet",
    makes_room=True,
)
being_achieved = MessageState(
    "being achieved",
    lambda one: one.is_being_achieved,
    "its achieving has started and has not ended",
)
achieved = MessageState(
    "achieved", lambda one: one.is_achieved, "it was achieved with the last event"
)
resolved = MessageState(
    "resolved",
    lambda one: one.is_done_after_failure,
    "it was done after a failure, with the last event",
)
killed = MessageState(
    "killed",
    lambda one: one.is_killed,
    "it was killed, and has not ended before the last event",
)
failed = MessageState(
    "failed", lambda one: bool(one.failure), "it has a failure that has not been dealt with"
)
recovering = MessageState(
    "recovering", lambda one: one.is_recovering, "an exception handler is at work on its failure"
)
suspended = MessageState(
    "suspended",
    lambda one: one.is_suspended,
    "it is suspended, alone or with an ancestor",
    makes_room=True,
)
fired = MessageState(
    "fired",
    lambda one: one.is_fire or one.has_fired,
    "a wiretap or monitor sent it with the last event, or it is a monitor that then sent an action",
)
retried = MessageState("retried", lambda one: one.is_retried, "it was retried with the last event")

STATES = {state.words: state for state in globals().values() if isinstance(state, MessageState)}
"""The states by name."""

_LONGEST_FIRST = sorted(STATES, key=len, reverse=True)


def handled_by(module: str) -> OfMessages:
    """Return the predicate of messages of any name that a module is handling now.

    Args:
        module: the module's name in central. A second copy of module "base" is the module "base#2".

    Raises:
        BadProperty: *module* is not a valid name.
    """
    if not isinstance(module, str) or not module.strip() or not module.isprintable():
        raise BadProperty(
            f"the name of a module must have printable characters, not {module!r:.60}"
        )
    return OfMessages(f"handled by {module}", handled, module=module)


# --- from text ------------------------------------------------------------------------------------


def predicate_from(text: str) -> OfMessages:
    """Return the predicate that a text states. Raises BadProperty for other text."""
    text, data = split_data(text)
    if text.startswith("handled by "):
        module = _name(text.removeprefix("handled by "))
        return OfMessages(text, handled, module=module, data=data, is_typed=True)
    state, name = _state_and_name(text)
    message = "" if name == ANYTHING else name
    return OfMessages(f"{name} {state}", STATES[state], message=message, data=data, is_typed=True)


def _state_and_name(text: str) -> tuple[str, str]:
    for state in _LONGEST_FIRST:
        if text.startswith(f"{state} of "):
            return state, _name(text.removeprefix(f"{state} of "))
    for state in _LONGEST_FIRST:
        if text.endswith(f" {state}"):
            return state, _name(text.removesuffix(f" {state}"))
    if text in STATES:
        raise BadProperty(
            f"'{text}' names no message: write '{text} of MESSAGE', or '{text} of {ANYTHING}'"
        )
    state = text.partition(" of ")[0] if " of " in text else text.rsplit(" ", maxsplit=1)[-1]
    advice = did_you_mean(state, STATES) or f"states are {', '.join(STATES)}"
    raise BadProperty(f"'{text}' names no state of a message ('STATE of MESSAGE'): {advice}")


def _name(text: str) -> str:
    if name := unquoted(text):
        return name
    raise BadProperty("it names no message or module")
