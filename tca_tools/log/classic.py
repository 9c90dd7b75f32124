"""A journal in the words of TCA's own message log (TCA 8.5, ``central -lmstdrp``), for old eyes and old tools.

    Goal           take steps {3}:    gait planner {1} --> Resource gait   (Pending)  8:20:22.65
    Goal           take steps {3}:   Resource gait     --> gait planner    (Sent)     8:20:22.66
      Success      take steps {3}:                                                    8:20:22.90

Our facts say more than that log could: constraints, moments, why something was killed, and times below a hundredth are
left out here. Three lines have no counterpart in TCA, and say what was silent there: ``Dropped``, ``Retry`` and
``Recovered``. FireDemon is missing, since only what a demon monitor then sends is recorded. Times are UTC.
"""

import textwrap
from collections.abc import Callable, Iterable, Iterator
from datetime import UTC, datetime
from typing import Any, NamedTuple

from tca_wire.journal import facts
from tca_wire.points import ALL_MOMENTS, Moment
from tca_wire.text.bodies import data_text
from tca_wire.text.facts_in_words import by_whom, kill_reason
from tca_wire.text.printable import printable
from tca_wire.vocabulary import MessageClass, Outcome

_SERVER = "TCA Server"
_COLUMNS = 80
_DATA_LINES = 5
_CLASS_WIDTH, _NAME_WIDTH, _ROUTE_WIDTH, _STATE_WIDTH = 9, 15, 22, 11
_CLASSES = {
    MessageClass.MULTI_QUERY: "MultiQuery",
    MessageClass.EXCEPTION: "Exception",
    MessageClass.POINT_MONITOR: "Monitor",
    MessageClass.POLLING_MONITOR: "Monitor",
    MessageClass.DEMON_MONITOR: "Monitor",
}
_ON_HOLD = "ON HOLD"


class _Known(NamedTuple):
    """A message, or a copy of one, that was sent."""

    name: str
    message_class: MessageClass
    sender: str
    parent: int
    body: bytes


def classic_lines(entries: Iterable[facts.Entry]) -> Iterator[str]:
    """The lines of a journal."""
    log = _Log()
    for entry in entries:
        yield from log.lines(entry)


class _Log:
    """The messages under way, and where each is: new, on hold, pending or with a module."""

    def __init__(self) -> None:
        self._began = 0.0
        self._known: dict[int, _Known] = {}
        self._where: dict[int, str] = {}
        """Where what has not been sent yet waits, by delivery; "" for what has just come."""
        self._sent: set[int] = set()
        """Messages that are sent or queued with the event at hand."""
        self._given_up: set[int] = set()
        """Messages that are dropped with it."""
        self._reached: dict[int, int] = {}
        self._killed: set[int] = set()
        self._given_as: dict[int, int] = {}
        """Of tasks that are handled again: by delivery."""
        self._with: dict[int, str] = {}
        """The modules that handle them."""
        self._clock = ""

    def lines(self, entry: facts.Entry) -> Iterator[str]:
        """The lines of one event."""
        self._clock = _clock(self._began, entry.time)
        self._sent = {fact.message_id for fact in entry.facts if isinstance(fact, facts.Queued | facts.Delivered)}
        self._given_up = {fact.id for fact in entry.facts if isinstance(fact, facts.Dropped)}
        for fact in entry.facts:
            if isinstance(fact, facts.Opened):
                self._began = fact.began
                self._clock = _clock(fact.began, entry.time)
            if say := _SAY.get(type(fact)):
                yield from say(self, fact)

    # --- a line ------------------------------------------------------------------------------------------------------

    def _start(self, kind: str, number: int, more: str = "", name: str = "?") -> str:
        known = self._known.get(number)
        name = printable(known.name if known else name)
        return f"{kind:<{_CLASS_WIDTH}} {name:>{_NAME_WIDTH}} {{{number}}}:{more}"

    def _timed(self, line: str) -> str:
        """With the time in its column, or behind what is too long."""
        width = _CLASS_WIDTH + _NAME_WIDTH + 2 * _ROUTE_WIDTH + _STATE_WIDTH + 12
        return f"{line:<{width}} {self._clock}"

    def _routed(self, number: int, source: str, target: str, state: str) -> str:
        known = self._known[number]
        route = f"{printable(source):>{_ROUTE_WIDTH}} --> {printable(target):<{_ROUTE_WIDTH}} {state}"
        return self._timed(self._start(_class(known), number, route))

    def _origin(self, number: int) -> str:
        known = self._known[number]
        return f"{known.sender} {{{known.parent}}}" if known.parent else known.sender

    def _source(self, number: int) -> str:
        """Where a message comes from when it moves; then it is there no longer."""
        return self._where.pop(number, "") or self._origin(number)

    def _number(self, fact: facts.Queued | facts.Delivered) -> int:
        """The number by which it is shown: a copy has its own, a task keeps one; 0 if nothing is known of it."""
        known = self._known.get(fact.message_id)
        if known is None:
            return 0
        if known.message_class.is_task:
            if fact.id != fact.message_id:
                self._given_as[fact.id] = fact.message_id
            return fact.message_id
        self._known.setdefault(fact.id, known)
        return fact.id

    # --- what each fact looks like -----------------------------------------------------------------------------------

    def _opened(self, fact: facts.Opened) -> Iterator[str]:
        began = _wall(fact.began)
        on = f"{began:%a %b %d %H:%M:%S %Y}" if began else "an unknown day"
        yield f"Logging Task Control Server {printable(fact.central)} on {on}"

    def _closed(self, fact: facts.Closed) -> Iterator[str]:
        yield f"Closing the Task Control Server: {printable(fact.why)}"

    def _joined(self, fact: facts.ModuleJoined) -> Iterator[str]:
        yield printable(f"New connection ({fact.module}, {fact.process})")

    def _left(self, fact: facts.ModuleLeft) -> Iterator[str]:
        yield printable(f"Closing {fact.module}: {fact.why}")

    def _received(self, fact: facts.Received) -> Iterator[str]:
        parent = fact.parent or fact.origin
        self._known[fact.id] = _Known(fact.message, fact.message_class, fact.sender, parent, fact.body)
        if fact.message_class.is_task and fact.id not in self._sent:
            yield from self._move(fact.id, _ON_HOLD, "(Inactive)")

    def _queued(self, fact: facts.Queued) -> Iterator[str]:
        if number := self._number(fact):
            yield from self._move(number, f"Resource {fact.resource}" if fact.resource else "No Handler", "(Pending)")

    def _unqueued(self, fact: facts.Unqueued) -> Iterator[str]:
        number = self._given_as.get(fact.id, fact.id)
        if number in self._known and number not in self._killed and number not in self._given_up:
            yield from self._move(number, _ON_HOLD, "(Inactive)")

    def _delivered(self, fact: facts.Delivered) -> Iterator[str]:
        if number := self._number(fact):
            yield from self._move(number, fact.module, "(Sent)")
            self._where.pop(number, None)
            self._with[number] = fact.module

    def _move(self, number: int, target: str, state: str) -> Iterator[str]:
        """A message goes somewhere; its data are told the first time."""
        is_new = number not in self._where and number not in self._with
        yield self._routed(number, self._source(number), target, state)
        self._where[number] = target
        yield from _data(self._known[number].body) if is_new else ()

    def _returned(self, fact: facts.Returned) -> Iterator[str]:
        number = self._given_as.get(fact.id, fact.id)
        known = self._known.get(number)
        if known is None or fact.outcome is not Outcome.DONE:
            return  # a failure comes with a fact of its own
        if known.message_class.has_reply:
            server = printable(self._with.get(number, ""))
            route = f"{server:>{_ROUTE_WIDTH}} --> {printable(self._origin(number))}"
            yield self._timed(self._start("  Reply", number, route))
            yield from _data(fact.body)
        else:
            kind = "  Success" if known.message_class.is_task and not known.message_class.is_monitor else "  Done"
            yield self._timed(self._start(kind, number))
        if not known.message_class.is_task:
            self._forget(number)

    def _failed(self, fact: facts.Failed) -> Iterator[str]:
        why = f" {fact.failure}: {fact.text}" if fact.text else f" {fact.failure}"
        yield self._timed(self._start("  Failure", fact.id, printable(why)))

    def _unhandled(self, fact: facts.Unhandled) -> Iterator[str]:
        if not fact.undecided:
            yield f"Failure  *Top Level*: {self._name(fact.task)} was not handled"

    def _reached_moments(self, fact: facts.Reached) -> Iterator[str]:
        known = self._known.get(fact.task)
        if known is None or not known.message_class.is_task:
            return
        self._reached[fact.task] = self._reached.get(fact.task, 0) | fact.moments
        is_killed = fact.task in self._killed
        if known.message_class.is_monitor and fact.moments & int(Moment.START_HANDLING) and not is_killed:
            yield self._routed(fact.task, self._source(fact.task), _SERVER, "(Sent)")  # which carries it out itself
        if self._reached[fact.task] == ALL_MOMENTS:
            self._forget(fact.task)
            if is_killed:
                yield f"Terminated {printable(known.name)} {{{fact.task}}}"

    def _killed_one(self, fact: facts.Killed) -> Iterator[str]:
        self._killed.add(fact.task)
        name = self._name(fact.task)
        why = kill_reason(fact.why, fact.by)
        yield printable(f"Will Terminate {name} when all references to it are released: {why}")

    def _dropped(self, fact: facts.Dropped) -> Iterator[str]:
        why = f"{fact.why}: {fact.where}" if fact.where else fact.why
        yield self._timed(self._start("  Dropped", fact.id, f" {printable(why)}", fact.message))

    def _retried(self, fact: facts.Retried) -> Iterator[str]:
        yield self._timed(self._start("  Retry", fact.task, printable(by_whom(fact.by))))

    def _recovered(self, fact: facts.Recovered) -> Iterator[str]:
        yield self._timed(self._start("  Recovered", fact.task))

    def _monitor_ended(self, fact: facts.MonitorEnded) -> Iterator[str]:
        route = f"{'':>{2 * _ROUTE_WIDTH + 5}} (Completed)"
        yield self._timed(self._start("Monitor", fact.monitor, route))

    def _tap_fired(self, fact: facts.TapFired) -> Iterator[str]:
        if not fact.listener:
            yield f"Tap Message of {self._name(fact.tapped)} Ignored: No Handler"

    def _name(self, number: int) -> str:
        known = self._known.get(number)
        return f"{printable(known.name) if known else '?'} {{{number}}}"

    def _forget(self, number: int) -> None:
        for known in (self._reached, self._where, self._with):
            known.pop(number, None)


def _class(known: _Known) -> str:
    return _CLASSES.get(known.message_class, str(known.message_class).capitalize())


def _data(body: bytes) -> Iterator[str]:
    """The data of a message on lines below it, cut after some."""
    if text := data_text(body):
        lines = textwrap.wrap(text, _COLUMNS - 4, break_on_hyphens=False)
        more = len(lines) > _DATA_LINES
        yield from (f"    {line}" for line in lines[:_DATA_LINES])
        if more:
            yield "    ..."


def _clock(began: float, time: float) -> str:
    """The time of day, in hundredths of a second."""
    hundredths = int((began + time) * 100 + 1e-6)
    seconds = hundredths // 100 % 86_400
    return f"{seconds // 3600}:{seconds // 60 % 60:02d}:{seconds % 60:02d}.{hundredths % 100:02d}"


def _wall(began: float) -> datetime | None:
    try:
        return datetime.fromtimestamp(began, UTC)
    except (ValueError, OverflowError, OSError):
        return None


# ruff: noqa: SLF001
_SAY: dict[type, Callable[[_Log, Any], Iterator[str]]] = {
    facts.Opened: _Log._opened,
    facts.Closed: _Log._closed,
    facts.ModuleJoined: _Log._joined,
    facts.ModuleLeft: _Log._left,
    facts.Received: _Log._received,
    facts.Queued: _Log._queued,
    facts.Unqueued: _Log._unqueued,
    facts.Delivered: _Log._delivered,
    facts.Returned: _Log._returned,
    facts.Failed: _Log._failed,
    facts.Unhandled: _Log._unhandled,
    facts.Reached: _Log._reached_moments,
    facts.Killed: _Log._killed_one,
    facts.Dropped: _Log._dropped,
    facts.Retried: _Log._retried,
    facts.Recovered: _Log._recovered,
    facts.MonitorEnded: _Log._monitor_ended,
    facts.TapFired: _Log._tap_fired,
}
