"""What can be said of messages: predicates, as functions and as text.

P          STATE of MESSAGE [with FIELD=VALUE, ...] | MESSAGE STATE [with ...] | handled by MODULE [with ...]
MESSAGE    a message's name, or anything; in quotes where words of the language are in it
STATE      begun, handled, planned ahead, ...: see STATES
FIELD, VALUE   of its data: see wanted_data.py
"""

from collections.abc import Callable
from difflib import get_close_matches

from tca_tools.check.errors import BadProperty
from tca_tools.check.records import Item
from tca_tools.check.wanted_data import Wanted, cut_data, unquoted

STATES: dict[str, tuple[Callable[[Item], bool], str]] = {
    "sent": (lambda item: item.is_new, "with this entry"),
    "begun": (lambda item: item.is_begun, "a handler was given it, now or before"),
    "handled": (lambda item: item.is_handled, "a handler has it"),
    "queued": (lambda item: item.is_queued, "it waits for a resource, or for a handler"),
    "planned": (lambda item: item.is_planned, "it has been expanded, with all that is under it"),
    "planned ahead": (lambda item: item.is_planned_ahead, "it was begun, and may not be achieved yet"),
    "being achieved": (lambda item: item.is_being_achieved, "its achieving has started and not ended"),
    "achieved": (lambda item: item.is_achieved, "with this entry"),
    "killed": (lambda item: item.is_killed, "it was killed, and has ended with this entry at the earliest"),
    "failed": (lambda item: bool(item.failure), "a failure was raised that has not been dealt with"),
    "recovering": (lambda item: item.is_recovering, "an exception handler is at work on its failure"),
    "suspended": (lambda item: item.is_suspended, "by itself, or with what it is under"),
    "fired": (lambda item: item.is_fire or item.has_fired, "a wiretap or monitor sent it, or it sent its action"),
    "retried": (lambda item: item.is_retried, "with this entry"),
}
"""What can be said of a message: the test, and what it means."""

ENDS_WITH_ITS_MESSAGE = frozenset(("begun", "planned", "planned ahead", "suspended"))
"""What is not said any more of a message that has ended with this entry, where messages are counted."""

ANYTHING = "anything"
_LONGEST_FIRST = sorted(STATES, key=len, reverse=True)


class Those:
    """The predicate that finds the messages under way for which a test holds."""

    def __init__(
        self, words: str, test: Callable[[Item], bool], *, message: str = "", module: str = "", wanted: list[Wanted]
    ) -> None:
        self.words = words + (f" with {', '.join(map(str, wanted))}" if wanted else "")
        self.message = message  #: the name that it is about ("": any)
        self.module = module
        self.wanted = wanted
        self.has_subject = False
        """Whether there was any message that it is about, in whatever state: else that it never held says nothing."""
        self.ends_with_its_message = False
        self._test = test

    @property
    def subject(self) -> str:
        """What it is about, in words."""
        return (self.message or ANYTHING) + (f" with {', '.join(map(str, self.wanted))}" if self.wanted else "")

    def test(self, item: Item) -> bool:
        """Whether it is true of a message."""
        if self.has_subject and not self._test(item):  # the cheaper question first
            return False
        fits = [wanted.fits(item) for wanted in self.wanted] if self.message in ("", item.message) else [False]
        is_about = all(fits)
        self.has_subject = self.has_subject or is_about
        return is_about and self._test(item)


def predicate_from(text: str) -> Those:
    """The predicate that a text states. Raises BadProperty."""
    text, wanted = cut_data(text)
    if text.startswith("handled by "):
        module = _name(text.removeprefix("handled by "))
        return Those(text, lambda item: item.module == module, module=module, wanted=wanted)
    state, name = _state_and_name(text)
    message = "" if name == ANYTHING else name
    found = Those(f"{name} {state}", STATES[state][0], message=message, wanted=wanted)
    found.ends_with_its_message = state in ENDS_WITH_ITS_MESSAGE
    return found


def _state_and_name(text: str) -> tuple[str, str]:
    for state in _LONGEST_FIRST:
        if text.startswith(f"{state} of "):
            return state, _name(text.removeprefix(f"{state} of "))
    for state in _LONGEST_FIRST:
        if text.endswith(f" {state}"):
            return state, _name(text.removesuffix(f" {state}"))
    if text in STATES:
        raise BadProperty(f"'{text}' names no message: write '{text} of MESSAGE', or '{text} of {ANYTHING}'")
    said = text.partition(" of ")[0] if " of " in text else text.rsplit(" ", maxsplit=1)[-1]
    nearest = get_close_matches(said, STATES, n=1)
    advice = f"did you mean '{nearest[0]}'?" if nearest else f"states are {', '.join(STATES)}"
    raise BadProperty(f"'{text}' names no state of a message ('STATE of MESSAGE'): {advice}")


def _name(text: str) -> str:
    if name := unquoted(text):
        return name
    raise BadProperty("it names no message, or no module")
