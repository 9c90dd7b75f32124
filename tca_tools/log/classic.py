"""A journal in the format of TCA's own message log (TCA 8.5, ``central -lmstdrp``), for old tools.

    Goal           take steps {3}:    gait planner {1} --> Resource gait   (Pending)  8:20:22.65
    Goal           take steps {3}:   Resource gait     --> gait planner    (Sent)     8:20:22.66
      Success      take steps {3}:                                                    8:20:22.90

That log has no words for constraints and moments, so they are left out. Times are UTC, in
hundredths of a second. Three lines are new: TCA did not log drops, retries and recoveries.
FireDemon is missing, since only the messages of a fired demon monitor are recorded.
"""

import textwrap
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime

from tca_tools.journal.fold import History
from tca_tools.journal.records import Message, Task
from tca_wire.journal import facts
from tca_wire.points import END_ACHIEVING, START_HANDLING
from tca_wire.text.bodies import data_text
from tca_wire.text.facts_in_words import by_whom, kill_reason
from tca_wire.text.printable import printable
from tca_wire.vocabulary import MessageClass, Outcome

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


def classic_lines(entries: Iterable[facts.Entry]) -> Iterator[str]:
    """Yield the lines of a journal."""
    log = _Log()
    for entry in entries:
        log.run.apply(entry)
        log.time = entry.time
        log.moved = {
            fact.message_id
            for fact in entry.facts
            if isinstance(fact, facts.Queued | facts.Delivered)
        }
        log.dropped = {fact.id for fact in entry.facts if isinstance(fact, facts.Dropped)}
        for fact in entry.facts:
            yield from log.moves(fact)
            yield from log.endings(fact)
            yield from map(printable, log.remarks(fact))


class _Log:
    """The run up to the present entry, and the place of each message."""

    def __init__(self) -> None:
        self.run = History()
        self.time = 0.0
        self.moved: set[int] = set()
        """Messages that are delivered or queued in the present entry."""
        self.dropped: set[int] = set()
        """Messages and copies that are dropped in the present entry."""
        self._places: dict[int, str] = {}
        """The last place of each message: on hold, a resource, or (empty) a module."""

    def moves(self, fact: facts.Fact) -> Iterator[str]:
        """Yield the lines of a message that moves to another place."""
        match fact:
            case facts.Received() if fact.message_class.is_task and fact.id not in self.moved:
                yield from self._move(fact.id, "ON HOLD", "(Inactive)")
            case facts.Queued():
                target = f"Resource {fact.resource}" if fact.resource else "No Handler"
                yield from self._move(fact.id, target, "(Pending)")
            case facts.Unqueued() if fact.id not in self.dropped and not self._is_killed(fact.id):
                yield from self._move(fact.id, "ON HOLD", "(Inactive)")
            case facts.Delivered():
                yield from self._move(fact.id, fact.module, "(Sent)", stays=False)
            case facts.Reached() if fact.moments & START_HANDLING and not self._is_killed(
                fact.task
            ):
                # central carries out monitors itself
                if self.run.tasks[fact.task].message_class.is_monitor:
                    yield from self._move(fact.task, "TCA Server", "(Sent)", stays=False)

    def endings(self, fact: facts.Fact) -> Iterator[str]:
        """Yield the lines of a message's outcome."""
        match fact:
            # a failure has a fact of its own
            case facts.Returned() if fact.outcome is Outcome.DONE:
                yield from self._returned(fact)
            case facts.Failed():
                text = f": {fact.text}" if fact.text else ""
                yield self._line("  Failure", fact.id, f" {fact.failure}{text}")
            case facts.Dropped():
                name = self.run.name(fact.id) if fact.id in self.run.messages else fact.message
                where = f": {fact.where}" if fact.where else ""
                yield self._line("  Dropped", fact.id, f" {fact.why}{where}", name)
            case facts.Retried():
                yield self._line("  Retry", fact.task, by_whom(fact.by))
            case facts.Recovered():
                yield self._line("  Recovered", fact.task)
            case facts.MonitorEnded():
                blank = " " * (2 * _ROUTE_WIDTH + 5)
                yield self._line("Monitor", fact.monitor, f"{blank} (Completed)")

    def remarks(self, fact: facts.Fact) -> Iterator[str]:
        """Yield the lines without a time."""
        describe = self.run.describe
        match fact:
            case facts.Opened():
                yield f"Logging Task Control Server {fact.central} on {_day(fact.began)}"
            case facts.Closed():
                yield f"Closing the Task Control Server: {fact.why}"
            case facts.ModuleJoined():
                yield f"New connection ({fact.module}, {fact.process})"
            case facts.ModuleLeft():
                yield f"Closing {fact.module}: {fact.why}"
            case facts.Unhandled() if not fact.undecided:
                yield f"Failure  *Top Level*: {describe(fact.task)} was not handled"
            case facts.Killed():
                why = kill_reason(fact.why, fact.by)
                yield (
                    f"Will Terminate {describe(fact.task)}"
                    f" when all references to it are released: {why}"
                )
            case facts.Reached() if fact.moments & END_ACHIEVING and self._is_killed(fact.task):
                yield f"Terminated {describe(fact.task)}"
            case facts.TapFired() if not fact.listener:
                yield f"Tap Message of {describe(fact.tapped)} Ignored: No Handler"

    def _move(self, delivery: int, target: str, state: str, *, stays: bool = True) -> Iterator[str]:
        """Yield the line of a move, with the message's data the first time.

        A copy has its own number, a task keeps its number. A message that was sent before the
        journal started has no line.
        """
        message = self.run.delivered(delivery)
        if message is not None:
            number = message.id if isinstance(message, Task) else delivery
            source = self._places.get(number) or _sender(message)
            route = f"{source:>{_ROUTE_WIDTH}} --> {target:<{_ROUTE_WIDTH}} {state}"
            yield self._line(_class(message), number, route, message.name)
            yield from () if number in self._places else _data(message.body)
            self._places[number] = target if stays else ""

    def _returned(self, fact: facts.Returned) -> Iterator[str]:
        message = self.run.delivered(fact.id)
        if message is None:
            return
        kind = message.message_class
        if kind.has_reply:
            module = next((one.module for one in message.handlings if one.delivery == fact.id), "")
            route = f"{module:>{_ROUTE_WIDTH}} --> {_sender(message)}"
            yield self._line("  Reply", fact.id, route, message.name)
            yield from _data(fact.body)
        else:
            number = message.id if isinstance(message, Task) else fact.id
            word = "  Success" if kind.is_task and not kind.is_monitor else "  Done"
            yield self._line(word, number, "", message.name)

    def _is_killed(self, delivery: int) -> bool:
        message = self.run.delivered(delivery)
        return isinstance(message, Task) and message.killed is not None

    def _line(self, kind: str, number: int, more: str = "", name: str = "") -> str:
        """Return a line with the time in its column, or at the end of a longer line."""
        name = name or self.run.name(number)
        line = printable(f"{kind:<{_CLASS_WIDTH}} {name:>{_NAME_WIDTH}} {{{number}}}:{more}")
        width = _CLASS_WIDTH + _NAME_WIDTH + 2 * _ROUTE_WIDTH + _STATE_WIDTH + 12
        hundredths = int(((self.run.began or 0.0) + self.time) * 100 + 1e-6)
        seconds = hundredths // 100 % 86_400
        clock = f"{seconds // 3600}:{seconds // 60 % 60:02d}:{seconds % 60:02d}"
        return f"{line:<{width}} {clock}.{hundredths % 100:02d}"


def _class(message: Message) -> str:
    return _CLASSES.get(message.message_class, str(message.message_class).capitalize())


def _sender(message: Message) -> str:
    parent = (message.parent if isinstance(message, Task) else 0) or message.origin
    return f"{message.sender} {{{parent}}}" if parent else message.sender


def _data(body: bytes) -> Iterator[str]:
    """Yield the data of a message, cut after a few lines."""
    lines = textwrap.wrap(data_text(body), _COLUMNS - 4, break_on_hyphens=False)
    yield from (f"    {line}" for line in lines[:_DATA_LINES])
    yield from ["    ..."] * (len(lines) > _DATA_LINES)


def _day(began: float) -> str:
    try:
        return f"{datetime.fromtimestamp(began, UTC):%a %b %d %H:%M:%S %Y}"
    except (ValueError, OverflowError, OSError):
        return "an unknown day"
