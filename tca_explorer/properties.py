"""What must be true of a scenario. Properties are made of predicates: plain functions of the World (world.py).

A predicate returns a truth value or the messages that it is true of; ``at_most`` counts these. A property sees the
world after every action of every run, and remembers one number from the run so far.
"""

from collections.abc import Callable, Iterable, Sized
from typing import Any

from msgspec import UNSET

from tca_explorer.asking import CALLS
from tca_explorer.checks import checked_name, checked_number, nearest
from tca_explorer.errors import ScenarioError
from tca_explorer.world import Seen, World, shown
from tca_wire.messages.declarations import Message
from tca_wire.vocabulary import LONGEST_TIME

Predicate = Callable[[World], object]

_MICROSECONDS = 1_000_000  # in a second
_END_WITH_THEIR_MESSAGE = frozenset(("begun", "planned", "planned ahead", "suspended"))


class Property:
    """Something that must be true of every run."""

    def __init__(self, words: str, *predicates: Predicate) -> None:
        for predicate in predicates:
            if not callable(predicate):
                raise ScenarioError(f"{predicate!r:.60} is no predicate: give begun(MESSAGE), ... or a "
                                    "function of the World")  # fmt: skip
        self.words = words
        self.predicates = predicates

    def __repr__(self) -> str:
        return self.words

    @property
    def named(self) -> list["Those"]:
        """The ready-made predicates that it is made of: they name messages and modules."""
        return [one for one in self.predicates if isinstance(one, Those)]

    def seen(self, world: World, memory: int) -> tuple[int, str]:
        """After an action: what to remember, and what is wrong ("": nothing)."""
        del world
        return memory, ""

    may_be_owed = False
    """Whether it says that something must happen."""

    def is_owed(self, memory: int) -> bool:
        """Whether something must still happen."""
        del memory
        return False

    def has_case(self, world: World) -> bool:
        """Whether there is anything to judge here; where there never is, that it holds says nothing."""
        del world
        return True

    is_certain = False
    """Whether it is broken by what is there, whatever was before: asked of a journal of which a part is missing."""

    counts = False
    """Whether what came last is what is too many."""

    @property
    def case(self) -> str:
        """What there must be, once, to judge it by: in words."""
        return ""


class _Never(Property):
    is_certain = True

    def seen(self, world: World, memory: int) -> tuple[int, str]:
        found = self.predicates[0](world)
        return memory, shown(found) or "here it is" if found else ""


class _Always(Property):
    def seen(self, world: World, memory: int) -> tuple[int, str]:
        return memory, "" if self.predicates[0](world) else "here it is not"


class _AtMost(Property):
    is_certain = counts = True

    def __init__(self, words: str, predicate: Predicate, most: int) -> None:
        super().__init__(words, predicate)
        self._most = most

    def seen(self, world: World, memory: int) -> tuple[int, str]:
        found = _under_way(self.predicates[0], world)
        number = _number(found)
        return memory, f"here {number}: {shown(found)}" if number > self._most else ""

    def has_case(self, world: World) -> bool:
        return bool(self.predicates[0](world))

    @property
    def case(self) -> str:
        return _name(self.predicates[0])


class _AtMostInAll(_AtMost):
    def seen(self, world: World, memory: int) -> tuple[int, str]:
        found = self.predicates[0](world)
        memory += _number(found)
        return memory, f"here it comes to {memory}: {shown(found)}" if memory > self._most else ""


class _Before(Property):
    def seen(self, world: World, memory: int) -> tuple[int, str]:
        first, second = self.predicates
        memory = memory or int(bool(first(world)))
        found = None if memory else second(world)
        return memory, f"the second came first{': ' * bool(shown(found))}{shown(found)}" if found else ""

    def has_case(self, world: World) -> bool:
        return bool(self.predicates[1](world))

    @property
    def case(self) -> str:
        return _name(self.predicates[1])


class _Eventually(Property):
    may_be_owed = True

    def seen(self, world: World, memory: int) -> tuple[int, str]:
        return memory or int(bool(self.predicates[0](world))), ""

    def is_owed(self, memory: int) -> bool:
        return not memory


class _Within(Property):
    """Remembers for how many microseconds the second has been owed, and one more; 0: it is not."""

    may_be_owed = True

    def __init__(self, words: str, first: Predicate, second: Predicate, seconds: float) -> None:
        super().__init__(words, first, second)
        self._most = round(seconds * _MICROSECONDS)

    def seen(self, world: World, memory: int) -> tuple[int, str]:
        first, second = self.predicates
        if memory:
            memory += round(world.passed * _MICROSECONDS)
        is_late = memory - 1 > self._most
        found = first(world)
        if second(world):
            return 0, self._late(memory) if is_late else ""
        return memory or int(bool(found)), self._late(memory) if is_late else ""

    def _late(self, memory: int) -> str:
        return f"here {(memory - 1) / _MICROSECONDS:g} s have passed"

    def is_owed(self, memory: int) -> bool:
        return bool(memory)

    def has_case(self, world: World) -> bool:
        return bool(self.predicates[0](world))

    @property
    def case(self) -> str:
        return _name(self.predicates[0])


class NeverStuck(Property):
    """Nobody waits for ever: see ``never_stuck``. What is left is for the exploration to say."""


def checked_properties(properties: Iterable[Any]) -> tuple[Property, ...]:
    """*properties*, if they are. Raises ScenarioError."""
    found = tuple(properties)
    for one in found:
        if not isinstance(one, Property):
            raise ScenarioError(f"{one!r:.60} is no property: give never(...), before(...), never_stuck(), ...")
    return found


def never(predicate: Predicate) -> Property:
    """*predicate* is never true."""
    return _Never(f"never {_name(predicate)}", predicate)


def always(predicate: Predicate) -> Property:
    """*predicate* is true from the beginning to the end, after every action."""
    return _Always(f"always {_name(predicate)}", predicate)


def at_most(number: int, predicate: Predicate) -> Property:
    """*predicate* is true of at most *number* messages at a time."""
    checked_number(number, "at_most()", least=0)
    return _AtMost(f"at most {number} {_name(predicate)}", predicate, number)


def at_most_in_all(number: int, event: Predicate) -> Property:
    """In each run *event* happens at most *number* times: for what is true for one action only, such as ``sent``,
    ``fired`` and ``retried``.
    """
    checked_number(number, "at_most_in_all()", least=0)
    return _AtMostInAll(f"at most {number} {_name(event)} in all", event, number)


def before(first: Predicate, second: Predicate) -> Property:
    """Where *second* becomes true, *first* has been true before, or becomes true with the same action."""
    return _Before(f"{_name(first)} before {_name(second)}", first, second)


def eventually(predicate: Predicate) -> Property:
    """*predicate* becomes true in every run: before it ends, which is when nothing further need happen (losses, kills
    and goodbyes need not), or before it comes to go round in a circle for ever.
    """
    return _Eventually(f"eventually {_name(predicate)}", predicate)


def within(seconds: float, first: Predicate, second: Predicate) -> Property:
    """Whenever *first* is true, *second* becomes true with the same action, or before more than *seconds* have passed.

    Time passes with delays, deadlines, periods and timeouts, and with nothing else: handlers take none of it, or last
    until something is due. *first* should be true for a moment, such as ``sent``, or end.
    """
    is_number = isinstance(seconds, int | float) and not isinstance(seconds, bool)
    if not (is_number and 0 <= seconds <= LONGEST_TIME):
        raise ScenarioError(f"within() can't judge {seconds!r:.60} seconds: give a number from 0 to {LONGEST_TIME:g}")
    return _Within(f"{_name(second)} within {seconds:g} s of {_name(first)}", first, second, seconds)


def never_stuck() -> Property:
    """Nobody waits for ever: every run that ends leaves no task behind, and no script that still waits; and in a run
    that goes round in a circle for ever, no task and no script waits for the same thing all the time.
    """
    return NeverStuck("never stuck")


# --- predicates ------------------------------------------------------------------------------------------------------


class Those:
    """The predicate that finds the messages under way for which a test holds: those of a *message*, or a *module*."""

    def __init__(self, words: str, test: Callable[[Seen], bool], *, message: str = "", module: str = "") -> None:
        self.words = words
        self.message = message  #: which it names, if it does
        self.module = module
        self.ends_with_its_message = False
        """Whether ``at_most`` counts nothing that has ended with the last action: it makes room for the next."""
        self._test = test

    def __call__(self, world: World) -> list[Seen]:
        """Those of them that are under way now, or ended with the last action."""
        return [seen for seen in world.messages if self._test(seen)]


def _those(state: str, message: Message[Any, Any], data: Any, test: Callable[[Seen], bool]) -> Those:
    if not isinstance(message, Message):
        raise ScenarioError(f"{state.replace(' ', '_')}() takes a message (Goal, Command, ...), and {message!r:.60} is "
                            "none: give its declaration")  # fmt: skip
    name = message.name
    if data is UNSET:
        found = Those(f"{name} {state}", lambda seen: seen.message == name and test(seen), message=name)
    else:
        found = Those(f"{name} {data!r} {state}",
                      lambda seen: seen.message == name and test(seen) and seen.data == data, message=name)  # fmt: skip
    found.ends_with_its_message = state in _END_WITH_THEIR_MESSAGE
    return found


def begun(message: Message[Any, Any], data: Any = UNSET) -> Those:
    """Messages (with that *data*) that a handler was given, now or before."""
    return _those("begun", message, data, lambda seen: seen.is_begun)


def handled(message: Message[Any, Any], data: Any = UNSET) -> Those:
    """Messages that a handler has now."""
    return _those("handled", message, data, lambda seen: seen.is_handled)


def queued(message: Message[Any, Any], data: Any = UNSET) -> Those:
    """Messages that wait for a resource, or for a handler."""
    return _those("queued", message, data, lambda seen: seen.is_queued)


def planned(message: Message[Any, Any], data: Any = UNSET) -> Those:
    """Tasks that have been expanded, with all that is under them."""
    return _those("planned", message, data, lambda seen: seen.is_planned)


def planned_ahead(message: Message[Any, Any], data: Any = UNSET) -> Those:
    """Tasks that were begun and may not be achieved yet."""
    return _those("planned ahead", message, data, lambda seen: seen.is_planned_ahead)


def being_achieved(message: Message[Any, Any], data: Any = UNSET) -> Those:
    """Tasks whose achieving has started and not ended."""
    return _those("being achieved", message, data, lambda seen: seen.is_being_achieved)


def achieved(message: Message[Any, Any], data: Any = UNSET) -> Those:
    """Tasks that were achieved with the last action."""
    return _those("achieved", message, data, lambda seen: seen.is_achieved)


def killed(message: Message[Any, Any], data: Any = UNSET) -> Those:
    """Tasks that were killed and have not ended, or ended with the last action."""
    return _those("killed", message, data, lambda seen: seen.is_killed)


def failed(message: Message[Any, Any], data: Any = UNSET) -> Those:
    """Messages on which a failure was raised that has not been dealt with, and which have not ended, or ended with the
    last action.
    """
    return _those("failed", message, data, lambda seen: bool(seen.failure))


def recovering(message: Message[Any, Any], data: Any = UNSET) -> Those:
    """Tasks on whose failure an exception handler is at work."""
    return _those("recovering", message, data, lambda seen: seen.is_recovering)


def suspended(message: Message[Any, Any], data: Any = UNSET) -> Those:
    """Tasks that are suspended, by themselves or with what they are under."""
    return _those("suspended", message, data, lambda seen: seen.is_suspended)


def sent(message: Message[Any, Any], data: Any = UNSET) -> Those:
    """Messages that were sent with the last action, by whomever."""
    return _those("sent", message, data, lambda seen: seen.is_new)


def fired(message: Message[Any, Any], data: Any = UNSET) -> Those:
    """With the last action: listeners that a wiretap sent, actions that a monitor sent; or monitors that sent one."""
    return _those("fired", message, data, lambda seen: seen.is_fire or seen.has_fired)


def retried(message: Message[Any, Any], data: Any = UNSET) -> Those:
    """Tasks that were retried with the last action."""
    return _those("retried", message, data, lambda seen: seen.is_retried)


def accepted(call: str, by: str = "") -> Predicate:
    """With the last action: that central took what a script (of the module *by*) asked for by this call of the module
    library: "kill", "retry", "on_termination", ...; "send" is a message of any class. What is refused, or comes too
    late to change anything, is not accepted; a wait or a lock is accepted when it begins.
    """
    if call not in CALLS:
        raise ScenarioError(f"accepted() knows no call {call!r:.60}; {nearest(str(call), CALLS)}")
    if by:
        checked_name(by, "a module")
    return _Accepted(call, by)


class _Accepted(Those):
    """That a request was taken."""

    def __init__(self, call: str, by: str) -> None:
        super().__init__(f"{call}{f' of {by}' * bool(by)} accepted", lambda _: False, module=by)
        self._call = call

    def __call__(self, world: World) -> list[Any]:
        """That request, if it was taken with the last action."""
        taken = world.taken
        if taken is None or taken.call != self._call:
            return []
        return [taken] if self.module in ("", taken.sender, taken.sender.partition("#")[0]) else []


def handled_by(module: str) -> Those:
    """Messages of any name that handlers of *module* have now. A run of it that joins before the connections of the
    one before have all ended is called "base#2", as in central, and is another module.
    """
    checked_name(module, "a module")
    return Those(f"handled by {module}", lambda seen: seen.module == module, module=module)


def _under_way(predicate: Predicate, world: World) -> object:
    """What a predicate is true of at a time: what has ended makes room for what begins with the same action."""
    found = predicate(world)
    if isinstance(predicate, Those) and predicate.ends_with_its_message and isinstance(found, list):
        return [seen for seen in found if not seen.is_over]
    return found


def _number(found: object) -> int:
    return len(found) if isinstance(found, Sized) else int(bool(found))


def _name(predicate: Predicate) -> str:
    words = getattr(predicate, "words", "") or getattr(predicate, "__name__", repr(predicate))
    return str(words).replace("_", " ")
