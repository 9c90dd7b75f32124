"""What must be true of a run: properties, made of predicates.

A property sees the world after every event of a run, and remembers one number from the run so far.
"""

from collections.abc import Collection
from typing import Any, NamedTuple

from tca_properties.errors import BadProperty
from tca_properties.predicates import Named, OfMessages, predicate_from
from tca_properties.world import Found, Predicate, PredicateValues
from tca_wire.vocabulary import LONGEST_TIME

_MICROSECONDS = 1_000_000  # in a second


class Breach(NamedTuple):
    """What is wrong with a property after an event."""

    what: str
    messages: Collection[Any] = ()
    """The messages by which it is broken."""
    newest: Collection[Any] = ()
    """Where there are too many: those that came last."""


class Property:
    """Something that must be true of every run."""

    may_be_owed = False
    """Whether it says that something must happen."""

    is_certain = False
    """Whether messages that break it do so whatever was before: asked of a journal of which a part is missing."""

    def __init__(self, words: str, *predicates: Predicate) -> None:
        self.words = words
        self.predicates = predicates

    def __repr__(self) -> str:
        return self.words

    @property
    def named(self) -> list[Named]:
        """Its predicates that name messages or modules."""
        return [one for one in self.predicates if isinstance(one, Named)]

    @property
    def case(self) -> Predicate | None:
        """What there must be, once, or that it holds says nothing; None if it always says something."""
        return None

    def seen(self, values: PredicateValues, memory: int) -> tuple[int, Breach | None]:
        """After an event: what to remember, and what is wrong."""
        del values
        return memory, None

    def is_owed(self, memory: int) -> bool:
        """Whether something must still happen."""
        del memory
        return False


class _Never(Property):
    """A predicate is never true."""

    is_certain = True

    def seen(self, values: PredicateValues, memory: int) -> tuple[int, Breach | None]:
        found = values.true_of(self.predicates[0])
        if not found.is_true:
            return memory, None
        return memory, Breach("", found.messages) if found.messages else Breach("here it is")


class _Always(Property):
    """A predicate is always true."""

    def seen(self, values: PredicateValues, memory: int) -> tuple[int, Breach | None]:
        return memory, None if values.true_of(self.predicates[0]).is_true else Breach("here it is not")


class _AtMost(Property):
    """A predicate is true of so many messages at a time, and no more."""

    is_certain = True

    def __init__(self, words: str, predicate: Predicate, most: int) -> None:
        super().__init__(words, predicate)
        self._most = most

    @property
    def case(self) -> Predicate:
        return self.predicates[0]

    def seen(self, values: PredicateValues, memory: int) -> tuple[int, Breach | None]:
        predicate = self.predicates[0]
        found = values.true_of(predicate)
        if found.number > self._most and isinstance(predicate, OfMessages) and predicate.makes_room:
            left = [one for one in found.messages or () if not one.is_over]
            found = Found(bool(left), left)
        if found.number <= self._most:
            return memory, None
        messages = found.messages or ()
        return memory, Breach(f"here {found.number}", messages, values.newly(predicate).messages or messages)


class _AtMostInAll(_AtMost):
    """A predicate comes true so many times in a run, and no more."""

    def seen(self, values: PredicateValues, memory: int) -> tuple[int, Breach | None]:
        found = values.newly(self.predicates[0])
        memory += found.number
        if memory <= self._most or not found.is_true:
            return memory, None
        return memory, Breach(f"here it comes to {memory}", found.messages or ())


class _Before(Property):
    """A predicate comes true before another."""

    @property
    def case(self) -> Predicate:
        return self.predicates[1]

    def seen(self, values: PredicateValues, memory: int) -> tuple[int, Breach | None]:
        first, second = self.predicates
        memory = memory or int(values.true_of(first).is_true)
        found = Found(is_true=False) if memory else values.true_of(second)
        return memory, Breach("the second came first", found.messages or ()) if found.is_true else None


class _Eventually(Property):
    """A predicate comes true in every run."""

    may_be_owed = True

    def seen(self, values: PredicateValues, memory: int) -> tuple[int, Breach | None]:
        return memory or int(values.true_of(self.predicates[0]).is_true), None

    def is_owed(self, memory: int) -> bool:
        return not memory


class _Within(Property):
    """A predicate comes true soon after another: it remembers for how many microseconds that is owed, and one more."""

    may_be_owed = True

    def __init__(self, words: str, first: Predicate, second: Predicate, seconds: float) -> None:
        super().__init__(words, first, second)
        self._most = round(seconds * _MICROSECONDS)

    @property
    def case(self) -> Predicate:
        return self.predicates[0]

    def seen(self, values: PredicateValues, memory: int) -> tuple[int, Breach | None]:
        first, second = self.predicates
        if memory:
            memory += round(values.passed * _MICROSECONDS)
        passed = memory - 1
        breach = Breach(f"here {passed / _MICROSECONDS:g} s have passed") if passed > self._most else None
        is_asked = values.true_of(first).is_true
        return 0 if values.true_of(second).is_true else memory or int(is_asked), breach

    def is_owed(self, memory: int) -> bool:
        return bool(memory)


class NeverStuck(Property):
    """Nobody waits for ever. Who shows the run says what is left at its end."""


def never(predicate: str | Predicate) -> Property:
    """*predicate* is never true."""
    return _Never(f"never {words_of(predicate)}", _checked(predicate))


def always(predicate: str | Predicate) -> Property:
    """*predicate* is true from the beginning to the end, after every event."""
    return _Always(f"always {words_of(predicate)}", _checked(predicate))


def at_most(number: int, predicate: str | Predicate) -> Property:
    """*predicate* is true of at most *number* messages at a time."""
    _check_number(number, "at_most()")
    return _AtMost(f"at most {number} {words_of(predicate)}", _checked(predicate), number)


def at_most_in_all(number: int, event: str | Predicate) -> Property:
    """In each run *event* happens at most *number* times: for what is true for one event only, such as ``sent``,
    ``fired`` and ``retried``.
    """
    _check_number(number, "at_most_in_all()")
    return _AtMostInAll(f"at most {number} {words_of(event)} in all", _checked(event), number)


def before(first: str | Predicate, second: str | Predicate) -> Property:
    """Where *second* becomes true, *first* has been true before, or becomes true with the same event."""
    return _Before(f"{words_of(first)} before {words_of(second)}", _checked(first), _checked(second))


def eventually(predicate: str | Predicate) -> Property:
    """*predicate* becomes true in every run: before it ends, which is when nothing further need happen (losses, kills
    and goodbyes need not), or before it comes to go round in a circle for ever.
    """
    return _Eventually(f"eventually {words_of(predicate)}", _checked(predicate))


def within(seconds: float, first: str | Predicate, second: str | Predicate) -> Property:
    """Whenever *first* is true, *second* becomes true with the same event, or before more than *seconds* have passed.

    In an exploration time passes with delays, deadlines, periods and timeouts, and with nothing else: handlers take
    none of it, or last until something is due. *first* should be true for a moment, such as ``sent``, or end.
    """
    is_number = isinstance(seconds, int | float) and not isinstance(seconds, bool)
    if not (is_number and 0 <= seconds <= LONGEST_TIME):
        raise BadProperty(f"within() can't judge {seconds!r:.60} seconds: give a number from 0 to {LONGEST_TIME:g}")
    words = f"{words_of(second)} within {seconds:g} s of {words_of(first)}"
    return _Within(words, _checked(first), _checked(second), seconds)


def never_stuck() -> Property:
    """Nobody waits for ever: every run that ends leaves no task behind, and no script that still waits; and in a run
    that goes round in a circle for ever, no task and no script waits for the same thing all the time.
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
        raise BadProperty(f"{predicate!r:.60} is no predicate: give begun(MESSAGE), ... or a function of the World")
    return predicate  # type: ignore[no-any-return]


def _check_number(number: Any, what: str) -> None:
    if not isinstance(number, int) or isinstance(number, bool) or number < 0:
        raise BadProperty(f"{what} can't be {number!r:.60}: 0 or more, a whole number")
