"""Properties of a run, built from predicates.

A property sees the world after every event of a run, and remembers one number.
"""

from collections.abc import Callable, Collection
from typing import Any, NamedTuple

from tca_tools.properties.predicates import NamedPredicate, OfMessages, predicate_from
from tca_tools.properties.world import BadProperty, Predicate, PredicateValue, PredicateValues
from tca_wire.vocabulary import LONGEST_TIME

_MICROSECONDS = 1_000_000  # in a second


class Breach(NamedTuple):
    """The breach of a property by an event."""

    what: str
    messages: Collection[Any] = ()
    """The messages that break the property."""
    newest: Collection[Any] = ()
    """If too many messages match, those of them that match since this event."""


Outcome = tuple[int, Breach | None]
"""The number to remember after an event, and the breach, if there is one."""


class Property:
    """Something that must be true of every run."""

    def __init__(
        self,
        words: str,
        *predicates: Predicate,
        seen: Callable[[PredicateValues, int], Outcome] = lambda _values, memory: (memory, None),
        is_owed: Callable[[int], bool] | None = None,
        case: Predicate | None = None,
        is_certain: bool = False,
    ) -> None:
        self.words = words
        self.predicates = predicates
        self.seen = seen
        """The function to call after each event, with the predicates' values and the memory."""
        self.may_be_owed = is_owed is not None
        self.is_owed = is_owed or (lambda _memory: False)
        """Returns, from the memory, whether something must still happen."""
        self.case = case
        """If this predicate is never true, the property holds trivially (None: it never does)."""
        self.is_certain = is_certain
        """Whether a breach is certain even if earlier parts of the journal are missing."""

    def __repr__(self) -> str:
        return self.words

    @property
    def named(self) -> list[NamedPredicate]:
        """The predicates that name messages or modules."""
        return [one for one in self.predicates if isinstance(one, NamedPredicate)]


class NeverStuck(Property):
    """The property that nothing waits for ever; the explorer and the check find the breach."""


def never(predicate: str | Predicate) -> Property:
    """Return the property that a predicate is never true.

    Args:
        predicate: a predicate, such as ``failed(MOVE)``, or its text, such as "failed of move".

    Raises:
        BadProperty: the predicate is invalid.

    Example::

        SAFE = never(killed(MOVE_BODY))
    """
    checked = _checked(predicate)

    def seen(values: PredicateValues, memory: int) -> Outcome:
        found = values.true_of(checked)
        breach = Breach("", found.messages) if found.messages else Breach("it is true here")
        return memory, breach if found.is_true else None

    return Property(f"never {words_of(predicate)}", checked, seen=seen, is_certain=True)


def always(predicate: str | Predicate) -> Property:
    """Return the property that a predicate is true after every event of the run.

    Args:
        predicate: a predicate or its text; see ``never``.

    Raises:
        BadProperty: the predicate is invalid.
    """
    checked = _checked(predicate)

    def seen(values: PredicateValues, memory: int) -> Outcome:
        return memory, None if values.true_of(checked).is_true else Breach("it is not true here")

    return Property(f"always {words_of(predicate)}", checked, seen=seen)


def at_most(number: int, predicate: str | Predicate) -> Property:
    """Return the property that a predicate is true for at most *number* messages at a time.

    Args:
        number: the largest number of messages.
        predicate: a predicate or its text; see ``never``.

    Raises:
        BadProperty: an argument is invalid.

    Example::

        AHEAD = at_most(1, planned_ahead(TAKE_STEPS))
    """
    _check_number(number, "at_most()")
    checked = _checked(predicate)

    def seen(values: PredicateValues, memory: int) -> Outcome:
        found = values.true_of(checked)
        if found.number > number and isinstance(checked, OfMessages) and checked.makes_room:
            left = [one for one in found.messages or () if not one.is_over]
            found = PredicateValue(bool(left), left)
        if found.number <= number:
            return memory, None
        messages = found.messages or ()
        return memory, Breach(
            f"here {found.number}", messages, values.newly(checked).messages or messages
        )

    return Property(
        f"at most {number} {words_of(predicate)}", checked, seen=seen, case=checked, is_certain=True
    )


def at_most_in_all(number: int, event: str | Predicate) -> Property:
    """Return the property that an event happens at most *number* times in a run.

    Args:
        number: the largest number of times.
        event: a predicate that is true for one event only, such as ``sent``, ``fired`` or
            ``retried``, or its text.

    Raises:
        BadProperty: an argument is invalid.
    """
    _check_number(number, "at_most_in_all()")
    checked = _checked(event)

    def seen(values: PredicateValues, memory: int) -> Outcome:
        found = values.newly(checked)
        memory += found.number
        if memory <= number or not found.is_true:
            return memory, None
        return memory, Breach(f"it has happened {memory} times", found.messages or ())

    return Property(
        f"at most {number} {words_of(event)} in all",
        checked,
        seen=seen,
        case=checked,
        is_certain=True,
    )


def before(first: str | Predicate, second: str | Predicate) -> Property:
    """Return the property that *first* becomes true before *second* does, or with the same event.

    Args:
        first: a predicate or its text; see ``never``.
        second: a predicate or its text.

    Raises:
        BadProperty: a predicate is invalid.
    """
    one, other = _checked(first), _checked(second)

    def seen(values: PredicateValues, memory: int) -> Outcome:
        memory = memory or int(values.true_of(one).is_true)
        found = PredicateValue(is_true=False) if memory else values.true_of(other)
        breach = Breach("the second came first", found.messages or ())
        return memory, breach if found.is_true else None

    return Property(
        f"{words_of(first)} before {words_of(second)}", one, other, seen=seen, case=other
    )


def eventually(predicate: str | Predicate) -> Property:
    """Return the property that a predicate becomes true in every run.

    It must become true before the run ends, or before the run enters a cycle for ever. A run ends
    when nothing more must happen; losses, kills and goodbyes never must.

    Args:
        predicate: a predicate or its text; see ``never``.

    Raises:
        BadProperty: the predicate is invalid.
    """
    checked = _checked(predicate)

    def seen(values: PredicateValues, memory: int) -> Outcome:
        return memory or int(values.true_of(checked).is_true), None

    return Property(
        f"eventually {words_of(predicate)}", checked, seen=seen, is_owed=lambda memory: not memory
    )


def within(seconds: float, first: str | Predicate, second: str | Predicate) -> Property:
    """Return the property that *second* becomes true within some time whenever *first* is true.

    In an exploration, time passes only with delays, deadlines, periods and timeouts. Handlers take
    no time, or run until something is due.

    Args:
        seconds: the longest time; 0 for the same event.
        first: a predicate that is true for a limited time, such as ``sent``, or its text.
        second: a predicate or its text.

    Raises:
        BadProperty: an argument is invalid.
    """
    is_number = isinstance(seconds, int | float) and not isinstance(seconds, bool)
    if not (is_number and 0 <= seconds <= LONGEST_TIME):
        raise BadProperty(f"within() needs seconds from 0 to {LONGEST_TIME:g}, not {seconds!r:.60}")
    one, other = _checked(first), _checked(second)
    most = round(seconds * _MICROSECONDS)

    def seen(values: PredicateValues, memory: int) -> Outcome:
        """Remember for how many microseconds *second* has been due, plus one (0: it is not due)."""
        if memory:
            memory += round(values.passed * _MICROSECONDS)
        passed = memory - 1
        breach = Breach(f"here {passed / _MICROSECONDS:g} s have passed") if passed > most else None
        is_asked = values.true_of(one).is_true
        return 0 if values.true_of(other).is_true else memory or int(is_asked), breach

    words = f"{words_of(second)} within {seconds:g} s of {words_of(first)}"
    return Property(words, one, other, seen=seen, is_owed=bool, case=one)


def never_stuck() -> Property:
    """Return the property that nothing waits for ever.

    When a run ends, no task is left and no script waits. In a run that repeats a cycle for ever, no
    task and no script waits for the same thing all the time.
    """
    return NeverStuck("never stuck")


def words_of(predicate: object) -> str:
    """Return a predicate in words."""
    if isinstance(predicate, str):
        return predicate
    words = getattr(predicate, "words", "") or getattr(predicate, "__name__", repr(predicate))
    return str(words).replace("_", " ")


def _checked(predicate: Any) -> Predicate:
    if isinstance(predicate, str):
        return predicate_from(predicate)
    if not callable(predicate):
        raise BadProperty(
            f"{predicate!r:.60} is not a predicate: use begun(MESSAGE), ... or a function"
        )
    return predicate  # type: ignore[no-any-return]


def _check_number(number: Any, what: str) -> None:
    if not isinstance(number, int) or isinstance(number, bool) or number < 0:
        raise BadProperty(f"the number of {what} must be a whole number from 0, not {number!r:.60}")
