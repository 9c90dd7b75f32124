"""Properties of a run, made of predicates.

A property sees the world after every event of a run, and remembers one number from the run so far.
"""

from collections.abc import Callable, Collection
from typing import Any, NamedTuple

from tca_tools.properties.predicates import NamedPredicate, OfMessages, predicate_from
from tca_tools.properties.world import BadProperty, Found, Predicate, PredicateValues
from tca_wire.vocabulary import LONGEST_TIME

_MICROSECONDS = 1_000_000  # in a second


class Breach(NamedTuple):
    """The error of a property after an event."""

    what: str
    messages: Collection[Any] = ()
    """The messages by which it is broken."""
    newest: Collection[Any] = ()
    """Where there are too many: those that came last."""


Outcome = tuple[int, Breach | None]
"""After an event: what to remember, and what is wrong."""


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
        """To be called after each event with what predicates say, and what is remembered."""
        self.may_be_owed = is_owed is not None
        self.is_owed = is_owed or (lambda _memory: False)
        """Whether something must still happen, given what is remembered."""
        self.case = case
        """The event or state without which it says nothing; None if it always says something."""
        self.is_certain = is_certain
        """Whether messages that break it do so whatever was before: asked of a journal of which a
        part is missing.
        """

    def __repr__(self) -> str:
        return self.words

    @property
    def named(self) -> list[NamedPredicate]:
        """Its predicates that name messages or modules."""
        return [one for one in self.predicates if isinstance(one, NamedPredicate)]


class NeverStuck(Property):
    """Nobody waits for ever. Who shows the run says what is left at its end."""


def never(predicate: str | Predicate) -> Property:
    """*predicate* is never true."""
    checked = _checked(predicate)

    def seen(values: PredicateValues, memory: int) -> Outcome:
        found = values.true_of(checked)
        breach = Breach("", found.messages) if found.messages else Breach("here it is")
        return memory, breach if found.is_true else None

    return Property(f"never {words_of(predicate)}", checked, seen=seen, is_certain=True)


def always(predicate: str | Predicate) -> Property:
    """*predicate* is true from the beginning to the end, after every event."""
    checked = _checked(predicate)

    def seen(values: PredicateValues, memory: int) -> Outcome:
        return memory, None if values.true_of(checked).is_true else Breach("here it is not")

    return Property(f"always {words_of(predicate)}", checked, seen=seen)


def at_most(number: int, predicate: str | Predicate) -> Property:
    """*predicate* is true of at most *number* messages at a time."""
    _check_number(number, "at_most()")
    checked = _checked(predicate)

    def seen(values: PredicateValues, memory: int) -> Outcome:
        found = values.true_of(checked)
        if found.number > number and isinstance(checked, OfMessages) and checked.makes_room:
            left = [one for one in found.messages or () if not one.is_over]
            found = Found(bool(left), left)
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
    """In each run *event* happens at most *number* times: for what is true for one event only, such
    as ``sent``, ``fired`` and ``retried``.
    """
    _check_number(number, "at_most_in_all()")
    checked = _checked(event)

    def seen(values: PredicateValues, memory: int) -> Outcome:
        found = values.newly(checked)
        memory += found.number
        if memory <= number or not found.is_true:
            return memory, None
        return memory, Breach(f"here it comes to {memory}", found.messages or ())

    return Property(
        f"at most {number} {words_of(event)} in all",
        checked,
        seen=seen,
        case=checked,
        is_certain=True,
    )


def before(first: str | Predicate, second: str | Predicate) -> Property:
    """Where *second* becomes true, *first* has been true before, or becomes true with the same
    event.
    """
    leader, follower = _checked(first), _checked(second)

    def seen(values: PredicateValues, memory: int) -> Outcome:
        memory = memory or int(values.true_of(leader).is_true)
        found = Found(is_true=False) if memory else values.true_of(follower)
        return memory, Breach(
            "the second came first", found.messages or ()
        ) if found.is_true else None

    return Property(
        f"{words_of(first)} before {words_of(second)}", leader, follower, seen=seen, case=follower
    )


def eventually(predicate: str | Predicate) -> Property:
    """*predicate* becomes true in every run: before it ends, which is when nothing further need
    happen (losses, kills and goodbyes need not), or before it comes to go round in a circle for
    ever.
    """
    checked = _checked(predicate)

    def seen(values: PredicateValues, memory: int) -> Outcome:
        return memory or int(values.true_of(checked).is_true), None

    return Property(
        f"eventually {words_of(predicate)}", checked, seen=seen, is_owed=lambda memory: not memory
    )


def within(seconds: float, first: str | Predicate, second: str | Predicate) -> Property:
    """Whenever *first* is true, *second* becomes true with the same event, or before more than
    *seconds* have passed.

    In an exploration time passes with delays, deadlines, periods and timeouts, and with nothing
    else: handlers take none of it, or last until something is due. *first* should be true for a
    moment, such as ``sent``, or end.
    """
    is_number = isinstance(seconds, int | float) and not isinstance(seconds, bool)
    if not (is_number and 0 <= seconds <= LONGEST_TIME):
        raise BadProperty(
            f"within() can't judge {seconds!r:.60} seconds: give a number from 0 to {LONGEST_TIME:g}"
        )
    leader, follower = _checked(first), _checked(second)
    most = round(seconds * _MICROSECONDS)

    def seen(values: PredicateValues, memory: int) -> Outcome:
        """Remembers for how many microseconds it has been owed, and one more."""
        if memory:
            memory += round(values.passed * _MICROSECONDS)
        passed = memory - 1
        breach = Breach(f"here {passed / _MICROSECONDS:g} s have passed") if passed > most else None
        is_asked = values.true_of(leader).is_true
        return 0 if values.true_of(follower).is_true else memory or int(is_asked), breach

    words = f"{words_of(second)} within {seconds:g} s of {words_of(first)}"
    return Property(words, leader, follower, seen=seen, is_owed=bool, case=leader)


def never_stuck() -> Property:
    """Nobody waits for ever: every run that ends leaves no task behind, and no script that still
    waits; and in a run that goes round in a circle for ever, no task and no script waits for the
    same thing all the time.
    """
    return NeverStuck("never stuck")


def words_of(predicate: object) -> str:
    """A predicate in words."""
    if isinstance(predicate, str):
        return predicate
    words = getattr(predicate, "words", "") or getattr(predicate, "__name__", repr(predicate))
    return str(words).replace("_", " ")


def _checked(predicate: Any) -> Predicate:
    if isinstance(predicate, str):
        return predicate_from(predicate)
    if not callable(predicate):
        raise BadProperty(
            f"{predicate!r:.60} is no predicate: give begun(MESSAGE), ... or a function of the World"
        )
    return predicate  # type: ignore[no-any-return]


def _check_number(number: Any, what: str) -> None:
    if not isinstance(number, int) or isinstance(number, bool) or number < 0:
        raise BadProperty(f"{what} can't be {number!r:.60}: 0 or more, a whole number")
