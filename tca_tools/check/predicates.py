"""What can be said of messages: predicates, as functions and as text.

P          STATE of MESSAGE [with FIELD=VALUE, ...] | MESSAGE STATE [with ...] | handled by MODULE
MESSAGE    a message's name, or anything; in quotes where words of the language are in it
STATE      begun, handled, planned ahead, ...: see STATES
VALUE      JSON, or a text; FIELD may have dots for the fields of a part
"""

import json
import re
from collections.abc import Callable
from difflib import get_close_matches
from typing import Any

from tca_tools.check.records import Item

STATES: dict[str, tuple[Callable[[Item], bool], str]] = {
    "sent": (lambda item: item.is_new, "with this event"),
    "begun": (lambda item: item.is_begun, "a handler was given it, now or before"),
    "handled": (lambda item: item.is_handled, "a handler has it"),
    "queued": (lambda item: item.is_queued, "it waits for a resource, or for a handler"),
    "planned": (lambda item: item.is_planned, "it has been expanded, with all that is under it"),
    "planned ahead": (lambda item: item.is_planned_ahead, "it was begun, and may not be achieved yet"),
    "being achieved": (lambda item: item.is_being_achieved, "its achieving has started and not ended"),
    "achieved": (lambda item: item.is_achieved, "with this event"),
    "killed": (lambda item: item.is_killed, "it was killed, and has ended with this event at the earliest"),
    "failed": (lambda item: bool(item.failure), "a failure was raised that has not been dealt with"),
    "recovering": (lambda item: item.is_recovering, "an exception handler is at work on its failure"),
    "suspended": (lambda item: item.is_suspended, "by itself, or with what it is under"),
    "fired": (lambda item: item.is_fire or item.has_fired, "a wiretap or monitor sent it, or it sent its action"),
    "retried": (lambda item: item.is_retried, "with this event"),
}
"""What can be said of a message: the test, and what it means."""

ANYTHING = "anything"
_LONGEST_FIRST = sorted(STATES, key=len, reverse=True)


class BadProperty(ValueError):
    """A text that is no property; its message says what, which and what to do."""


class Those:
    """The predicate that finds the messages under way for which a test holds."""

    def __init__(self, words: str, test: Callable[[Item], bool], message: str = "", module: str = "") -> None:
        self.words = words
        self.test = test
        self.message = message  #: the name that it is about ("": any)
        self.module = module


def predicate_from(text: str) -> Those:
    """The predicate that a text states. Raises BadProperty."""
    text, fields = _cut_fields(" ".join(text.split()))
    if text.startswith("handled by "):
        module = _unquoted(text.removeprefix("handled by "))
        return Those(text, lambda item: item.module == module, module=module)
    state, name = _state_and_name(text)
    test = STATES[state][0]
    words = f"{name} {state}" + (
        f" with {', '.join(f'{key}={value!r}' for key, value in fields.items())}" if fields else ""
    )
    if not fields:
        if name == ANYTHING:
            return Those(words, test)
        return Those(words, lambda item: item.message == name and test(item), name)
    message = "" if name == ANYTHING else name
    return Those(words, lambda item: message in ("", item.message) and test(item) and _has(item, fields), message)


def _state_and_name(text: str) -> tuple[str, str]:
    for state in _LONGEST_FIRST:
        if text.startswith(f"{state} of "):
            return state, _unquoted(text.removeprefix(f"{state} of "))
    for state in _LONGEST_FIRST:
        if text.endswith(f" {state}"):
            return state, _unquoted(text.removesuffix(f" {state}"))
    said = text.partition(" of ")[0] if " of " in text else text.rsplit(" ", maxsplit=1)[-1]
    nearest = get_close_matches(said, STATES, n=1)
    advice = f"did you mean '{nearest[0]}'?" if nearest else f"states are {', '.join(STATES)}"
    raise BadProperty(f"'{text}' names no state of a message ('STATE of MESSAGE'): {advice}")


def _unquoted(name: str) -> str:
    name = name.strip()
    if len(name) > 1 and name[0] == name[-1] and name[0] in "'\"":
        name = name[1:-1]
    if not name:
        raise BadProperty("it names no message")
    return name


# --- data ------------------------------------------------------------------------------------------------------------


def _cut_fields(text: str) -> tuple[str, dict[str, Any]]:
    """A predicate without its last part, and what that says of the message's data."""
    head, found, tail = text.rpartition(" with ")
    if not found or "=" not in tail:
        return text, {}
    fields = {}
    for part in re.split(r",\s*(?=[\w.]+\s*=)", tail):
        key, equals, value = part.partition("=")
        if not equals or not re.fullmatch(r"[\w.]+", key.strip()):
            raise BadProperty(f"'{part}' is no FIELD=VALUE")
        fields[key.strip()] = _value(value.strip())
    return head, fields


def _value(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return _unquoted(text)


def _has(item: Item, fields: dict[str, Any]) -> bool:
    try:
        data = item.data
    except ValueError:  # no data that can be read
        return False
    for key, wanted in fields.items():
        value = data
        for part in key.split("."):
            value = value.get(part) if isinstance(value, dict) else None
        if value != wanted:
            return False
    return True
