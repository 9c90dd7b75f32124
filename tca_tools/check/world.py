"""The messages under way at one event of a run, folded from the facts and from nothing else.

It keeps what has not ended and the names of what has, so it stays small. A journal may begin in the
middle: what was sent before is a stranger, of which nothing is claimed. The explorer has the same
world of the runs that it plays.
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
    """The record of a message that is over."""

    message: str
    message_class: MessageClass
    sender: str
    sent_by: str
    body: bytes
    """The value of a variable, which modules that come later get; of all else nothing."""


class JournalWorld:
    """The messages under way. What ended with the last event is still there; what ended before is
    not.
    """

    kept_out = False
    """Central has said, in the event that is being folded, that it sends no listener."""

    def __init__(self, violations: list[Violation], *, is_whole: bool, events: int = 0) -> None:
        self.violations = violations  #: those found are added here
        self.is_whole = is_whole  #: the journal is known from the beginning of the run
        #: The first number of which all must be known (0: not known yet), and the highest given so
        #: far.
        self.first, self.newest = int(is_whole), 0
        self.events = events  #: how many were seen before this one
        self.event, self.asked_by = 0, 0  #: its number, and the delivery whose handler asked for it
        self.now = 0.0
        self.is_holding = False  #: since a restart no task begins
        self.passed = 0.0  #: seconds that passed with the last event
        #: By number, oldest first; each copy of a broadcast has one of its own.
        self.items: dict[int, MessageRecord] = {}
        self.deliveries: dict[
            int, MessageRecord
        ] = {}  #: of tasks that are handled again: by delivery
        self.history: Run | None = None  #: all records so far, where properties ask for them
        self.strange: set[int] = set()  #: deliveries of what was sent before the journal begins
        self.over: dict[int, EndedMessage] = {}  #: the messages that are not under way any more
        self.joined: dict[str, None] = {}
        self.handlers: dict[
            str, dict[str, str]
        ] = {}  #: for each message its handlers: module and resource
        self.places: dict[tuple[str, str], ResourceRecord] = {}
        self._claims: defaultdict[tuple[str, str], ResourceClaims] = defaultdict(ResourceClaims)
        """By what the module calls itself, and the resource."""
        self.claims: dict[int, facts.Claimed] = {}
        self.taps: dict[int, facts.TapAdded] = {}
        self.late_taps: set[int] = set()  #: those on tasks that had ended, until they are fired
        self.taps_before: dict[str, dict[int, facts.TapAdded]] = {}  #: those that hold, by message
        self.attached: dict[int, facts.Attached] = {}
        self.invocations_at_root: dict[int, int] = {}  #: how often each attachment was called there
        self.waits: dict[WaitKey, list[int]] = {}  #: by who and for what: moments
        self.declared: dict[str, facts.FormatDefined] = {}  #: messages
        self.cycles: dict[str, LifeCycle] = {}  #: of their tasks
        self.accepting: set[tuple[str, str]] = set()
        """Messages and modules whose handlers say themselves when they accept a task."""
        # Of the event that is being folded:
        self.touched: dict[MessageRecord, None] = {}
        self.places_touched: dict[ResourceRecord, None] = {}
        self.slots_lost: set[ResourceRecord] = set()
        self.rehandled: set[str] = set()  #: messages that got or lost a handler
        self.later: list[
            Callable[[], None]
        ] = []  #: checks of what must be true when all of the event is known
        self.flagged: list[MessageRecord] = []  #: messages with marks for one event only

    # --- for properties ---------------------------------------------------------------------------

    @property
    def run(self) -> RunAt:
        """All that is known of the run until now: every task, what it waits for, what ended long
        ago.
        """
        if self.history is None:
            raise ValueError("the records are kept only where properties come from a file")
        return RunAt(self.history)

    @property
    def messages(self) -> list[MessageRecord]:
        """Everything under way, oldest first."""
        return list(self.items.values())

    @property
    def tasks(self) -> list[MessageRecord]:
        """The tasks among them."""
        return [item for item in self.items.values() if item.is_task]

    @property
    def modules(self) -> tuple[str, ...]:
        """Those connected, oldest first."""
        return tuple(self.joined)

    @property
    def held_by(self) -> dict[tuple[str, str], facts.Claimed]:
        """The locks and reservations in force, by module and resource."""
        return {
            key: place.claims.held_by for key, place in self.places.items() if place.claims.held_by
        }

    def parent(self, task: MessageRecord) -> MessageRecord | None:
        """The task that *task* is under; None: the root."""
        return task.parent

    def children(self, task: MessageRecord) -> list[MessageRecord]:
        """The tasks under *task* that have not ended, oldest first."""
        return list(task.children.values())

    # --- calls of the fold ------------------------------------------------------------------------

    def broken(self, rule: Rule, about: MessageRecord | int, what: str) -> None:
        """A rule is broken. *what* goes on from the message's name, if *about* is one and not a
        mere number.
        """
        number, words = (about, what) if isinstance(about, int) else (about.id, f"{about} {what}")
        self.violations.append(
            Violation(rule.text, rule.source, self.events, self.event, self.now, number, words)
        )

    def expect(
        self, is_so: Callable[[], object], rule: Rule, about: MessageRecord | int, what: str
    ) -> None:
        """When all facts of the event are known, this must be so; else *rule* is broken."""

        def check() -> None:
            if not is_so():
                self.broken(rule, about, what)

        self.later.append(check)

    def forget(self) -> None:
        """The next event, or action of an explored run, begins: forget what ended, and what is so
        for one only.
        """
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
        """An event begins."""
        self.kept_out = False
        self.asked_by = entry.cause.origin if isinstance(entry.cause, Request) else 0
        self.event = entry.number
        self.go_to(entry.time)
        for of_event in (self.touched, self.places_touched, self.slots_lost, self.rehandled):
            of_event.clear()

    def go_to(self, time: float) -> None:
        """Time passes."""
        self.passed, self.now = self.passed + max(time - self.now, 0.0), time

    def end(self) -> None:
        """All facts of the event are known."""
        for check in self.later:
            check()
        self.later.clear()

    def new_number(self, number: int, what: str) -> None:
        """A number is given to something: *what*, in words."""
        if number <= self.newest:
            again = number in self.items or number in self.over
            why = "was received before" if again else f"came after {self.name(self.newest)}"
            self.broken(NUMBERS, number, f"{what} {{{number}}} {why}")
        self.note_number(number)

    def note_number(self, number: int) -> None:
        """A number is known from now on, perhaps a new one."""
        self.first, self.newest = self.first or number, max(self.newest, number)

    def must_know(self, number: int) -> bool:
        """Whether what has that number has come since the journal began."""
        return 0 < self.first <= number

    def add(self, item: MessageRecord) -> None:
        """A message is under way."""
        item.message, item.sender = intern(item.message), intern(item.sender)
        self.items[item.id] = item
        self.flagged.append(item)
        self.touched[item] = None

    def finish(self, item: MessageRecord) -> None:
        """A message is over."""
        item.is_over = True
        self.flagged.append(item)
        self.touched[item] = None

    def known(self, number: int) -> MessageRecord | None:
        """The message under way of that number, or of the newest delivery of that number."""
        return self.items.get(number) or self.deliveries.get(number)

    def item(self, number: int, what: str) -> MessageRecord | None:
        """The message under way of that number, to which *what* happens; None, with a complaint if
        it can't.
        """
        item = self.known(number)
        if item is not None:
            self.touched[item] = None
            return item
        if number in self.over:
            self.broken(ENDED, number, f"{self.name(number)} {what}, though it is over")
        elif self.must_know(number) and number not in self.strange:
            self.broken(KNOWN, number, f"message {{{number}}} {what}, and was never sent")
        return None

    def task(self, number: int, what: str) -> MessageRecord | None:
        """The task of that number that has not ended; None, with a complaint if it can't."""
        item = self.item(number, what)
        if item is not None and not item.is_task:
            self.broken(KNOWN, item, f"{what}, and is no task but a {item.message_class}")
            return None
        if item is not None and item.is_over:
            self.broken(ENDED, item, f"{what} after its end")
            return None
        return item

    def delivery(self, fact: facts.Queued | facts.Delivered, what: str) -> MessageRecord | None:
        """The message queued or delivered: itself, a task that is handled again, or a new copy."""
        if fact.id == fact.message_id or fact.id in self.items or fact.id in self.deliveries:
            return self.item(fact.id, what)
        original = self.items.get(fact.message_id)
        if original is None and fact.message_id not in self.over:
            self.item(fact.message_id, what)
            self.strange.add(fact.id)
            return None
        self.note_number(fact.id)
        if original is not None and original.is_task:
            original.again = False
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
        """The copy of a message to many that one receiver gets."""
        if not original.message_class.fans_out:
            name = f"{original.message} {{{fact.message_id}}}"
            self.broken(
                ENDED,
                fact.message_id,
                f"{name} {what} as {{{fact.id}}}, though it is over, or another one",
            )
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

    def is_strange(self, number: int) -> bool:
        """Whether it was sent before the journal begins."""
        return 0 < number < self.first and number not in self.over and number not in self.items

    def place(self, module: str, resource: str) -> ResourceRecord:
        """A resource; one without a name stands for all that waits for a handler."""
        place = self.places.get((module, resource))
        if place is None:
            claims = self._claims[called(module), resource]
            place = self.places[module, resource] = ResourceRecord(module, resource, claims)
            claims.places.append(place)
        self.places_touched[place] = None
        return place

    def name(self, number: int) -> str:
        """A message's name with its number."""
        item = self.known(number) or self.over.get(number)
        return f"{item.message if item else '?'} {{{number}}}"


def said(place: ResourceRecord) -> str:
    """A resource in words."""
    return words_of_place(place.module, place.name) or "a handler"
