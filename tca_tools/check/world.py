"""The messages under way at one event of a run, folded from the facts only.

The world retains messages that have not ended, and the names of ended messages, so it stays small.
A journal may start in the middle: nothing is claimed about messages sent before. The explorer uses
the same world for the runs that it plays.
"""

from collections import defaultdict
from collections.abc import Callable
from sys import intern
from typing import NamedTuple

from tca_tools.check.records import MessageRecord, ResourceClaims, ResourceRecord, WaitKey
from tca_tools.check.rules import ENDED, KNOWN, NUMBERS, Rule, Violation
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.whole_run import Run
from tca_wire.journal import facts
from tca_wire.journal.causes import Request
from tca_wire.life_cycles import LifeCycle
from tca_wire.text.facts_in_words import called
from tca_wire.text.facts_in_words import place as words_of_place
from tca_wire.vocabulary import MessageClass


class EndedMessage(NamedTuple):
    """The data retained of a message that is over."""

    message: str
    message_class: MessageClass
    sender: str
    sent_by: str
    body: bytes
    """The value of a variable, which modules that join later receive; else empty."""


class JournalWorld:
    """The messages under way, including those that ended with the last event."""

    is_listener_refused = False
    """Whether central refused a listener in the current event."""

    def __init__(self, violations: list[Violation], *, is_whole: bool, events: int = 0) -> None:
        self.violations = violations  #: new violations are added here
        self.is_whole = is_whole  #: the journal has the whole run so far
        #: The number from which on all messages are known (0: not yet set), and the newest number.
        self.first, self.newest = int(is_whole), 0
        self.events = events  #: the number of events before the current one
        #: The number of the current event, and the delivery whose handler requested it.
        self.event, self.asked_by = 0, 0
        self.now = 0.0
        self.are_tasks_paused = False  #: whether no task starts, after a restart of central
        self.passed = 0.0  #: seconds that passed with the last event
        #: By number, oldest first; each copy of a broadcast has its own number.
        self.items: dict[int, MessageRecord] = {}
        self.deliveries: dict[int, MessageRecord] = {}  #: retried tasks, by delivery
        self.history: Run | None = None  #: all records so far, if properties need them
        self.unknown_deliveries: set[int] = set()  #: of messages from before the journal
        self.over: dict[int, EndedMessage] = {}  #: ended messages
        self.joined: dict[str, None] = {}
        #: For each message, the modules that handle it, with their resources.
        self.handlers: dict[str, dict[str, str]] = {}
        self.places: dict[tuple[str, str], ResourceRecord] = {}
        self._claims: defaultdict[tuple[str, str], ResourceClaims] = defaultdict(ResourceClaims)
        """By resource, and by module without the number of its copy."""
        self.claims: dict[int, facts.Claimed] = {}
        self.taps: dict[int, facts.TapAdded] = {}
        self.late_taps: set[int] = set()  #: the wiretaps added to ended tasks that have not fired
        #: By tapped message: the wiretaps that hold a task until their listener has ended.
        self.taps_before: dict[str, dict[int, facts.TapAdded]] = {}
        self.attached: dict[int, facts.Attached] = {}
        self.invocations_at_root: dict[int, int] = {}  #: the number of calls by attachment
        self.waits: dict[WaitKey, list[int]] = {}  #: the awaited moments
        self.declared: dict[str, facts.FormatDefined] = {}  #: by message
        self.cycles: dict[str, LifeCycle] = {}  #: by message
        self.accepting: set[tuple[str, str]] = set()
        """Messages and modules whose handlers accept tasks explicitly."""
        # State of the current event:
        self.touched: dict[MessageRecord, None] = {}
        self.places_touched: dict[ResourceRecord, None] = {}
        self.slots_lost: set[ResourceRecord] = set()
        self.handlers_changed: set[str] = set()  #: by message
        self.later: list[Callable[[], None]] = []  #: checks to run after all facts of the event
        self.flagged: list[MessageRecord] = []  #: messages with flags that last for one event

    # --- for properties ---------------------------------------------------------------------------

    @property
    def run(self) -> RunAt:
        """All records of the run until now, including ended tasks and waits."""
        if self.history is None:
            raise ValueError("the records are kept only for properties from a file")
        return RunAt(self.history)

    @property
    def messages(self) -> list[MessageRecord]:
        """All messages under way, oldest first."""
        return list(self.items.values())

    @property
    def tasks(self) -> list[MessageRecord]:
        """The tasks under way, oldest first."""
        return [item for item in self.items.values() if item.is_task]

    @property
    def modules(self) -> tuple[str, ...]:
        """The connected modules, oldest first."""
        return tuple(self.joined)

    @property
    def held_by(self) -> dict[tuple[str, str], facts.Claimed]:
        """The locks and reservations in force, by module and resource."""
        return {
            key: place.claims.held_by for key, place in self.places.items() if place.claims.held_by
        }

    def parent(self, task: MessageRecord) -> MessageRecord | None:
        """Return the parent of a task; None for the root."""
        return task.parent

    def children(self, task: MessageRecord) -> list[MessageRecord]:
        """Return the children of a task that have not ended, oldest first."""
        return list(task.children.values())

    # --- for the rules ----------------------------------------------------------------------------

    def report(self, rule: Rule, about: MessageRecord | int, what: str) -> None:
        """Record that a rule is broken.

        Args:
            rule: The rule.
            about: The message, or the number of one.
            what: The breach in words. They follow the message's name, except if *about* is a
                number.
        """
        number, words = (about, what) if isinstance(about, int) else (about.id, f"{about} {what}")
        self.violations.append(
            Violation(rule.text, rule.source, self.events, self.event, self.now, number, words)
        )

    def expect(
        self, is_so: Callable[[], object], rule: Rule, about: MessageRecord | int, what: str
    ) -> None:
        """Check a condition after all facts of the event; record a broken rule if it is false."""

        def check() -> None:
            if not is_so():
                self.report(rule, about, what)

        self.later.append(check)

    def forget(self) -> None:
        """Forget ended messages and one-event flags, before the next event or action."""
        self.passed = 0.0
        for item in self.flagged:
            item.is_new = item.is_retried = item.has_fired = False
            if item.is_over and self.items.pop(item.id, None) is not None:
                body = item.body if item.message_class.keeps_value else b""
                self.over[item.id] = EndedMessage(
                    item.message, item.message_class, item.sender, item.sent_by, body
                )
                self.deliveries.pop(item.handling_id, None)
        self.flagged.clear()

    def begin(self, entry: facts.Entry) -> None:
        """Start an event."""
        self.is_listener_refused = False
        self.asked_by = entry.cause.origin if isinstance(entry.cause, Request) else 0
        self.event = entry.number
        self.advance_to(entry.time)
        for of_event in (self.touched, self.places_touched, self.slots_lost, self.handlers_changed):
            of_event.clear()

    def advance_to(self, time: float) -> None:
        """Advance the time."""
        self.passed, self.now = self.passed + max(time - self.now, 0.0), time

    def end(self) -> None:
        """Run the pending checks after all facts of the event."""
        for check in self.later:
            check()
        self.later.clear()

    def new_number(self, number: int, what: str) -> None:
        """Check and record the number of something new, described by *what*."""
        if number <= self.newest:
            again = number in self.items or number in self.over
            why = "was received before" if again else f"came after {self.name(self.newest)}"
            self.report(NUMBERS, number, f"{what} {{{number}}} {why}")
        self.record_number(number)

    def record_number(self, number: int) -> None:
        """Record a number, which may be new."""
        self.first, self.newest = self.first or number, max(self.newest, number)

    def must_know(self, number: int) -> bool:
        """Whether a number was assigned after the start of the journal."""
        return 0 < self.first <= number

    def add(self, item: MessageRecord) -> None:
        """Add a message that is under way."""
        item.message, item.sender = intern(item.message), intern(item.sender)
        self.items[item.id] = item
        self.flagged.append(item)
        self.touched[item] = None

    def finish(self, item: MessageRecord) -> None:
        """Mark a message as over."""
        item.is_over = True
        self.flagged.append(item)
        self.touched[item] = None

    def known(self, number: int) -> MessageRecord | None:
        """Return the message under way with a number, or with that newest delivery."""
        return self.items.get(number) or self.deliveries.get(number)

    def item(self, number: int, what: str) -> MessageRecord | None:
        """Return the message under way with a number, to which *what* happens; else None.

        A message that is over breaks a rule. So does a number that was assigned after the journal
        started, but that no message has.
        """
        item = self.known(number)
        if item is not None:
            self.touched[item] = None
            return item
        if number in self.over:
            self.report(ENDED, number, f"{self.name(number)} {what}, though it is over")
        elif self.must_know(number) and number not in self.unknown_deliveries:
            self.report(KNOWN, number, f"message {{{number}}} {what}, but was never sent")
        return None

    def task(self, number: int, what: str) -> MessageRecord | None:
        """Return the open task with a number, to which *what* happens; else None, as ``item``."""
        item = self.item(number, what)
        if item is not None and not item.is_task:
            self.report(KNOWN, item, f"{what}, but is a {item.message_class}, not a task")
            return None
        if item is not None and item.is_over:
            self.report(ENDED, item, f"{what} after its end")
            return None
        return item

    def delivery(self, fact: facts.Queued | facts.Delivered, what: str) -> MessageRecord | None:
        """Return the queued or delivered message. It may be a retried task, or a new copy."""
        if fact.id == fact.message_id or fact.id in self.items or fact.id in self.deliveries:
            return self.item(fact.id, what)
        original = self.items.get(fact.message_id)
        if original is None and fact.message_id not in self.over:
            self.item(fact.message_id, what)
            self.unknown_deliveries.add(fact.id)
            return None
        self.record_number(fact.id)
        if original is not None and original.is_task:
            original.is_retry_due = False
            self.deliveries.pop(original.handling_id, None)
            original.handling_id, self.deliveries[fact.id] = fact.id, original
            self.touched[original] = None
            return original
        return self._copy(fact, original or self.over[fact.message_id], what)

    def _copy(
        self,
        fact: facts.Queued | facts.Delivered,
        original: MessageRecord | EndedMessage,
        what: str,
    ) -> MessageRecord | None:
        """Return a new copy of a message, for one receiver."""
        if not original.message_class.fans_out:
            name = f"{original.message} {{{fact.message_id}}}"
            what = f"{name} {what} as {{{fact.id}}}, though it is over or has another number"
            self.report(ENDED, fact.message_id, what)
            return None
        living = original if isinstance(original, MessageRecord) else None
        copy = MessageRecord(
            fact.id,
            original.message,
            original.message_class,
            original.sender,
            original.sent_by,
            original.body,
            original=living,
        )
        if living is not None:
            living.copies += 1
        self.add(copy)
        return copy

    def is_from_before(self, number: int) -> bool:
        """Whether a message was sent before the start of the journal."""
        return 0 < number < self.first and number not in self.over and number not in self.items

    def place(self, module: str, resource: str) -> ResourceRecord:
        """Return a resource; the one without a name contains messages that wait for a handler."""
        place = self.places.get((module, resource))
        if place is None:
            claims = self._claims[called(module), resource]
            place = self.places[module, resource] = ResourceRecord(module, resource, claims)
            claims.places.append(place)
        self.places_touched[place] = None
        return place

    def name(self, number: int) -> str:
        """Return a message's name with its number."""
        item = self.known(number) or self.over.get(number)
        return f"{item.message if item else '?'} {{{number}}}"


def place_in_words(place: ResourceRecord) -> str:
    """Return a resource in words."""
    return words_of_place(place.module, place.name) or "a handler"
