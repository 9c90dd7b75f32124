"""One connection's side of the protocol: its requests, their repetition, and deliveries.

Headers go in through ``receive`` and come out in ``outgoing``; time is passed in. Until central's
Welcome nothing but Hello leaves. A numbered request is kept until its answer is there; after a
break it is repeated in order: central knows it by its number and never does it twice. What is not
numbered (informs) may be lost.

A Welcome with another epoch says that central was restarted and its tree is lost. Open requests are
lost too, unless they name nothing of the old tree and only ask how things stand, or certainly never
reached the old central: they did not leave, or left once and were answered by Unknown. Messages and
handlers are declared again (``redeclaration``).
"""

from collections import deque
from collections.abc import Callable, Collection
from typing import Any, ClassVar
from weakref import WeakValueDictionary

import msgspec

from tca_module.session.epoch_numbers import RESTARTED, EpochNumber, first_foreign, numbers_in
from tca_module.session.joined_replies import HeldReplies, Item
from tca_module.session.lasting_attachments import LastingAttachments, is_lasting
from tca_module.session.open_deliveries import OpenDeliveries
from tca_module.session.redeclaration import Redeclaration
from tca_module.session.registering import registers
from tca_module.session.request import (
    HARMLESS,
    Request,
    check_fields,
    is_for_any_central,
    refers_to_tasks,
)
from tca_module.session.sent_tasks import TaskSends
from tca_wire.packets import headers
from tca_wire.packets.changes import ChangeState, Observe, Requested
from tca_wire.packets.parts import HandlerFormat, MessageFormat
from tca_wire.packets.routes import Barred, EntranceGone, Route
from tca_wire.text.measures import numbered
from tca_wire.vocabulary import Outcome, Refusal

HELLO_NUMBER = 1  # Hello keeps it when it is said again
QUIET = 2.5  # seconds without a word after which who waits for central asks it for one
IDLE = 45.0  # the same for who waits for nothing in particular: central beats every 30 seconds
REPEAT = 1.0  # seconds between two such questions
CONFIRM_EVERY = 100  # statements that may be on their way before central is asked for a word
PREFETCH = 64  # messages that a slot takes ahead
# to be said again after a break, until a further delivery shows that they arrived
_REPLIES_KEPT = PREFETCH + 8

# Declares nothing, so it changes nothing; but central answers it: either Accepted, or Unknown if
# Hello is due again.
_ARE_YOU_THERE = headers.Register(0, [], [])

_SPENT = headers.Send(0, "")


def quiet_within(patience: float, *, is_idle: bool = False) -> float:
    """The seconds of silence after which one who loses patience after so many asks central for a
    word.
    """
    return min(IDLE if is_idle else QUIET, 0.75 * patience)


class Session:
    """The state of one connection to central."""

    #: opens another slot for one that hangs
    replace_slot: Callable[[int, str], object] | None = None

    def __init__(self, hello: headers.Hello, attachments: LastingAttachments | None = None) -> None:
        """*attachments*: of the module, where it has several connections; the first one attaches
        them anew.
        """
        self._hello = msgspec.structs.replace(hello, number=HELLO_NUMBER)
        self._newest = HELLO_NUMBER
        self.requests: dict[int, Request] = {}  #: not over, by number, oldest first
        self.messages: dict[str, MessageFormat] = {}  #: declared, to be declared again
        self._handlers: dict[str, HandlerFormat] = {}
        #: central was told that all is attached that is attached at the start
        self._is_ready = False
        self.sends = TaskSends()  #: tasks that were sent without waiting
        self.open_deliveries = OpenDeliveries()  #: deliveries that are handled, or about to be
        #: granted, as long as anybody has them
        self._locks: WeakValueDictionary[int, Request] = WeakValueDictionary()
        self._replies: dict[int, tuple[headers.Reply | headers.Fail, bytes]] = {}
        """By delivery, oldest first: central may not have got these yet."""
        self._asked = float("-inf")  #: when central was last asked for a word
        self.asked_since = float(
            "-inf"
        )  #: when it was first asked for the one that it owes, if it does
        self.heard = float("-inf")  #: when central last said anything
        self.outgoing: list[Item] = []
        #: those in ``outgoing`` that leave together when a turn has ended
        self.held = HeldReplies()
        #: to be handled now, within a wait as well
        self.deliveries: deque[tuple[headers.Deliver, bytes]] = deque()
        #: to be handled when all before them have been
        self.ahead: deque[tuple[headers.Deliver, bytes]] = deque()
        #: to be called by the thread that owns the connection, soon
        self.news: deque[Callable[[], None]] = deque()
        #: headers about direct messages
        self.routing: deque[headers.Welcome | Route | EntranceGone | Barred] = deque()
        self.complaints: list[str] = []  #: central's complaints that answer no request; for the log
        #: informs and broadcasts that never left, or were on their way in a break
        self.dropped = self.doubtful = 0
        #: statements sent on this connection; those of which central has had word
        self._posted = self._arrived = 0
        self._confirming: Request | None = None  #: asks central for a word
        self._replies_before: list[int] = []  #: the deliveries that were answered before that
        self.is_welcome, self.breaks = False, 0  #: central has welcomed it; how often it has broken
        #: central is to be told that nothing is handled any more; set by any thread
        self.is_to_withdraw = False
        self.refused: headers.Refused | None = None  #: central does not want this connection
        self.epoch = ""
        self.module = hello.module  #: the name under which central knows the module
        self.attachments = LastingAttachments() if attachments is None else attachments
        own = LastingAttachments() if hello.connection else self.attachments
        self.redeclaration = Redeclaration(
            own, self.request, self.complaints.append, self._declare_handlers
        )

    # --- calls of the module ----------------------------------------------------------------------

    def request(self, header: Any, body: bytes = b"", *, wants_answer: bool = False) -> Request:
        """Make a numbered request of central. Raises MisuseError if central could not read it."""
        check_fields(header)
        self.make_way(header)
        return self.ask(header, body, wants_answer=wants_answer)

    def ask(self, header: Any, body: bytes, *, wants_answer: bool = True) -> Request:
        """Make a request whose fields have been checked."""
        request = Request(header, body, wants_answer=wants_answer)
        self.adopt(request)
        return request

    def send(self, header: headers.Send | ChangeState, body: bytes, what: str) -> Request:
        """Send a task, or change the state of one, as *what* says, without waiting for central's
        word; what it comes to is among ``sends`` if that is bad.
        """
        check_fields(header)
        if isinstance(header, headers.Send):
            header = msgspec.structs.replace(header, quiet=True)
        request = Request(header, body, wants_answer=False)
        request.what, request.by = what, self.open_deliveries.name_of(header.origin)
        self.sends.untold += 1
        self.adopt(request)
        return request

    def _send(self, request: Request) -> None:
        request.was_sent, request.epoch, request.mark, request.seen = (
            True,
            self.epoch,
            self._posted,
            0,
        )
        self.outgoing.append((request.header, request.body))

    def adopt(self, request: Request) -> None:
        """Ask central; also for a direct request that its handler has not begun."""
        request.path = None
        self._number(request)
        if self.is_welcome:
            self._send(request)
        elif self.refused is not None:
            self._refuse(request)

    def _number(self, request: Request) -> None:
        self._newest += 1
        request.header = msgspec.structs.replace(request.header, number=self._newest)
        self.requests[self._newest] = request

    def post(self, header: headers.ToCentral, body: bytes = b"") -> bool:
        """Say something that has no answer; False if it is lost because central is not there."""
        is_statement = isinstance(header, headers.Send | headers.SetVariable)
        if not self.is_welcome:
            self.dropped += is_statement
            return False
        self.outgoing.append((header, body))
        if is_statement:
            self._posted += 1
            if self.unheard >= CONFIRM_EVERY and (
                self._confirming is None or self._confirming.is_over
            ):
                self.confirm()
        return True

    def confirm(self) -> None:
        """Ask central for a word: its answer shows that all before has arrived."""
        self._confirming, self._replies_before = self.ask_for_word(), list(self._replies)

    def ask_for_word(self) -> Request:
        """Ask central for a word that comes after all that it has said; over when that is there."""
        return self.request(_ARE_YOU_THERE)

    @property
    def unheard(self) -> int:
        """The number of statements on this connection that may not have reached central."""
        return self._posted - self._arrived

    @property
    def lost(self) -> int:
        """The number of statements that did not reach central, or may not have when the connection
        broke; and of tasks that may not have when central ended.
        """
        return self.dropped + self.doubtful + len(self.sends.lost)

    @property
    def is_settled(self) -> bool:
        """Whether central has had all that was sent."""
        return self.is_welcome and not (self.unheard or self._replies or self.sends.untold)

    def take_outgoing(self, clock: Callable[[], float]) -> list[Item]:
        """What is to be sent, which is not kept any more."""
        outgoing, self.outgoing = self.outgoing, []
        return self.held.joined(outgoing, clock()) if self.held.ended else outgoing

    def reply(self, header: headers.Reply | headers.Fail, body: bytes, now: float = 0.0) -> bool:
        """A handler ended. Nothing is said of a delivery that central has forgotten. Returns
        whether it is held until its turn has ended.
        """
        if not self.open_deliveries.end(header.delivery):
            return False
        refusals, errors = self.sends.end(header.delivery)
        self.complaints += errors
        if refusals and isinstance(header, headers.Reply):
            header = msgspec.structs.replace(header, refusals=refusals)
        self._replies[header.delivery] = (header, body)
        self._keep_replies(_REPLIES_KEPT)
        if not self.is_welcome:
            return False
        self.outgoing.append((header, body))
        return self.held.take(header, now)

    def _keep_replies(self, number: int) -> None:
        """Forget all but the newest; central has got the others."""
        while len(self._replies) > number:
            del self._replies[next(iter(self._replies))]

    @property
    def has_next(self) -> bool:
        """Whether the next message is ahead, no handler owes an answer, and the module goes on."""
        is_free = bool(self.ahead) and len(self.open_deliveries) == len(self.ahead)
        return is_free and not self.open_deliveries.is_ending()

    @property
    def is_claiming(self) -> bool:
        """Whether a claim is open: what has to wait for it may yet come ahead."""
        return any(
            isinstance(one.header, headers.Lock | headers.GiveUp) for one in self.requests.values()
        )

    def make_way(self, header: headers.ToCentral) -> None:
        """Give back what came ahead before a claim, which might wait for it. Where no handler runs,
        but a callback, the next stays: central has given it to this slot by now, or recalls it.
        """
        if isinstance(header, headers.Lock) and self.ahead:
            kept = [self.ahead.popleft()] if self.has_next else []
            self.give_back()
            self.ahead.extend(kept)

    def give_back(self, wanted: Collection[int] | None = None) -> None:
        """Give back the deliveries that came ahead and have not begun, of those *wanted* (None: of
        all).
        """
        back = [
            header.delivery
            for header, _ in self.ahead
            if wanted is None or header.delivery in wanted
        ]
        self.ahead = deque(one for one in self.ahead if one[0].delivery not in back)
        for delivery in back:
            self.open_deliveries.end(delivery)
        self.post(headers.Recalled(back, is_answer=wanted is not None))

    def declared(
        self,
        messages: list[MessageFormat],
        handlers: list[HandlerFormat],
        *,
        is_ready: bool = False,
    ) -> None:
        """Remember what central has accepted, to declare it again after a restart."""
        self.messages.update({message.name: message for message in messages})
        self._handlers.update({handler.message: handler for handler in handlers})
        self._is_ready |= is_ready

    def withdrawn(self) -> None:
        """This module handles nothing any more."""
        self._handlers.clear()
        self.attachments.clear()

    # --- the connection ---------------------------------------------------------------------------

    def tend(self, now: float, since: float, quiet: float = QUIET) -> float:
        """Do what it is time for; when there is more to do, if nothing arrives before. After a
        silence central is asked for a word, every second. *since* is when somebody began to listen,
        *quiet* the seconds that it may have nothing to say.
        """
        if self.is_to_withdraw:
            self.is_to_withdraw = False
            self.withdrawn()
            self.request(headers.Unregister(0, []))
        is_restless = self.is_welcome and self.redeclaration.is_restless
        due = self.redeclaration.tend(now) if is_restless else float("inf")
        asks_at = max(self.heard, since) + quiet if self.is_welcome else self._asked + REPEAT
        if self.heard < self._asked:
            asks_at = max(asks_at, self._asked + REPEAT)
        if now >= asks_at:
            if self.heard >= self._asked:
                self.asked_since = now
            self._asked, asks_at = now, now + REPEAT
            self.outgoing.append((_ARE_YOU_THERE if self.is_welcome else self._hello, b""))
        return min(asks_at, due)

    def break_off(self) -> None:
        """Begin with Hello again: the connection broke, or central does not know it."""
        self.breaks += 1
        self.is_welcome = False
        dropped = self.dropped
        for header, _ in self.outgoing:
            self.dropped += (
                isinstance(header, headers.Send | headers.SetVariable) and not header.number
            )
            if (request := self.requests.get(getattr(header, "number", 0))) is not None:
                request.was_sent = request.repeated
        self.doubtful += self.unheard - (self.dropped - dropped)
        self._arrived = self._posted
        self.outgoing.clear()
        self.held.clear()
        for header, _ in self.ahead:  # central gives it again
            self.open_deliveries.end(header.delivery)
        self.ahead.clear()
        self._asked = float("-inf")

    def receive(self, header: headers.ToModule, body: bytes, now: float) -> None:
        """Take in what central said."""
        self.heard = now
        self._ON[type(header)](self, header, body)

    def _on_welcome(self, header: headers.Welcome, _: bytes) -> None:
        self.routing.append(header)  # whoever is welcomed is told of all routes anew
        is_back, is_new = bool(self.epoch), header.epoch != self.epoch
        if self.is_welcome:
            if not is_new:
                return  # Hello was said twice
            self.break_off()  # and the second one was heard by the next central
        self.epoch, self.module, self.refused = header.epoch, header.module, None
        if is_back and is_new:
            self._forget()
            self._renew()
        self.is_welcome = True
        is_anything = self.messages or self._handlers or self._is_ready
        if is_back and is_anything and (self.redeclaration.is_over or not is_new):
            is_over, messages = self.redeclaration.is_over, list(self.messages.values())
            handlers = list(self._handlers.values()) if is_over else []
            # Number 0: a new number would be higher than those repeated below, which central would
            # take for answered.
            self._declare(messages, handlers, is_ready=is_over and self._is_ready)
        if is_back and not is_new:
            self._declare_what_may_be_forgotten()
            self._observe_anew()
        for request in self.requests.values():
            request.repeated = request.was_sent
            if request.what and isinstance(
                request.header, headers.Send
            ):  # it is answered by itself
                request.header = msgspec.structs.replace(request.header, quiet=False)
            self._send(request)
        self.outgoing += self._replies.values()

    def _declare_what_may_be_forgotten(self) -> None:
        """Declare the handlers that central may have accepted, and forgotten with the connection:
        to the repeated request it only gives the answer that it gave then.
        """
        for header in [request.header for request in self.requests.values() if request.was_sent]:
            if isinstance(header, headers.Register) and (header.handlers or header.is_ready):
                self.outgoing.append((msgspec.structs.replace(header, number=0), b""))

    def _observe_anew(self) -> None:
        """Observe under new numbers: what central has told meanwhile is lost, and now it tells how
        things stand.
        """
        observing = [
            one
            for one in self.requests.values()
            if isinstance(one.header, Observe) and one.was_sent
        ]
        for request in observing:
            number = request.header.number
            del self.requests[number]
            self._number(Request(headers.GiveUp(number), b"", wants_answer=True))
            request.was_sent = False
            self._number(request)

    def _renew(self) -> None:
        """Redeclare to a new central before all else, under the lowest numbers."""
        waiting = dict(self.requests)
        self.requests.clear()
        self.redeclaration.begin(self.epoch, self.messages)
        if not self.requests:
            self.requests.update(waiting)
            return
        for request in waiting.values():
            self._number(request)

    def _declare_handlers(self) -> None:
        if self._handlers or self._is_ready:
            self._declare([], list(self._handlers.values()), is_ready=self._is_ready)

    def _declare(
        self, messages: list[MessageFormat], handlers: list[HandlerFormat], *, is_ready: bool
    ) -> None:
        self.outgoing += [
            (header, b"") for header in registers(messages, handlers, is_ready=is_ready)
        ]

    def _forget(self) -> None:
        """Central was restarted and has lost its tree."""
        for number, request in list(self.requests.items()):
            if request.settled is not None:
                del self.requests[number]  # a renewed request is sent anew
                continue
            named = first_foreign(numbers_in(request.header), self.epoch)
            if named is not None or refers_to_tasks(request.header):
                request.gone = named.what if named is not None else ""
                self.end(request, RESTARTED)
            elif request.was_sent and not is_for_any_central(request.header):
                self.end(request, "central was restarted meanwhile and has forgotten it")
            elif isinstance(request.header, Observe):
                request.answers.clear()  # about tasks that are no more
        for lock in self._locks.values():
            lock.taken = "central was restarted and has forgotten it"
        self._locks.clear()
        self._replies.clear()
        self.open_deliveries.forget()
        self.sends.forget()
        self.deliveries.clear()
        self.ahead.clear()

    def _answered(self, number: int) -> Request | None:
        """The request that central answers; what was sent before it has arrived."""
        request = self.requests.get(number)
        if request is not None:
            self._arrived = max(self._arrived, request.mark)
            if request is self._confirming:
                for delivery in self._replies_before:
                    self._replies.pop(delivery, None)
        return request

    def _on_accepted(self, header: headers.Accepted, _: bytes) -> None:
        request = self._answered(header.number)
        was_not_sent = (
            request is not None and isinstance(request.header, headers.Send) and not header.id
        )
        if request is not None and (was_not_sent or not request.wants_answer):
            asked = request.header
            what = numbered(
                asked.message if isinstance(asked, headers.Send) else "number", header.id
            )
            request.accepted = number = EpochNumber(header.id, self.epoch, what)
            if request.settled is None and is_lasting(asked):
                self.attachments.add(asked, self.messages, number)
            self.end(request)

    def _on_tasks_made(self, header: headers.TasksMade, _: bytes) -> None:
        for number, task in header.tasks:
            self._on_accepted(headers.Accepted(number, task), b"")

    def _on_refused(self, header: headers.Refused, _: bytes) -> None:
        request = self._answered(header.number)
        if header.refusal is Refusal.SHUT_OUT:
            self._not_welcome(header)
        elif request is None:
            if not self.is_welcome and (header.number == HELLO_NUMBER or not self.epoch):
                self._not_welcome(header)
            elif header.refusal is not Refusal.TOO_LATE:
                self.complaints.append(f"central refused: {header.text}")
            elif not header.number:  # else it was given up meanwhile
                self.complaints.append(header.text)
        elif header.refusal is Refusal.TOO_LATE and request.repeated and request.wants_answer:
            self._ask_again(request)
        else:
            request.refused = header
            self.end(request)

    def _not_welcome(self, header: headers.Refused) -> None:
        """Central refused Hello; with number 0 if it could not even read it, because it is of
        another version, or lets this connection in no more. It answers nothing: so all that waits
        for it is over. Hello is repeated.
        """
        if not header.number and header.refusal is Refusal.PROTOCOL:
            other = f"central speaks another protocol than this module's {headers.PROTOCOL_VERSION}"
            text = f"{other}: use one version of TCA for both (it says: {header.text})"
            header = msgspec.structs.replace(header, text=text)
        if self.is_welcome:
            self.break_off()
        if self.refused is None:
            self.refused = header
            self.complaints += [f"central refuses this module: {header.text}"] * bool(self.epoch)
        for request in list(self.requests.values()):
            self._refuse(request)
        for lock in self._locks.values():
            lock.taken = header.text
        self._locks.clear()

    def _refuse(self, request: Request) -> None:
        """A request that central will not answer is over, unless it declares again what central is
        to know.
        """
        if request.settled is None:
            request.refused = self.refused
            self.end(request)

    def _ask_again(self, request: Request) -> None:
        """Repeat a request that central dropped when the connection broke."""
        if isinstance(request.header, HARMLESS):
            del self.requests[request.header.number]
            request.taken, request.repeated = "", False
            self._number(request)
            self._send(request)
        else:  # A query may have been answered, a variable exchanged already; to ask again is the caller's decision.
            self.end(request, "the connection to central broke before the answer came")

    def _on_answer(self, header: headers.Answer, body: bytes) -> None:
        request = self._answered(header.number)
        if request is not None:
            request.answers.append((header, body))
            if not header.more:
                if isinstance(request.header, headers.Lock) and header.outcome is Outcome.DONE:
                    self._locks[header.number] = request
                self.end(request)
            else:
                request.seen += 1
                self._tell_of(request)

    def _tell_of(self, request: Request) -> None:
        """There is news of a request: let those know who want to."""
        self.news += [tell for tell in (request.notify, request.wakes) if tell is not None]

    def end(self, request: Request, lost: str = "") -> None:
        """A request is over, or was *lost*: call those who want to know."""
        self.requests.pop(request.header.number, None)  # one that went directly has no number here
        request.is_over = True
        if lost:
            request.lost = lost
        if request.what:
            self._end_send(request)
        if request.settled is not None:
            request.settled(request)
        self._tell_of(request)

    def _end_send(self, request: Request) -> None:
        """Central's word of a task that was sent is there, or never will be."""
        self.sends.untold -= 1
        origin = request.header.origin
        if request.lost:
            self.sends.lost.append(request)
        elif request.refused is None:
            request.header, request.body, request.after = (
                _SPENT,
                b"",
                [],
            )  # its id may be kept for ever
        elif request.refused.refusal is Refusal.TOO_LATE and isinstance(
            request.header, ChangeState
        ):
            self.complaints.append(request.why_failed)  # who is late need not have known it
        elif not origin or origin in self.open_deliveries:
            self.sends.add(request)
        else:  # its handler has returned: central has let that fail
            self.complaints.append(request.why_unheard)

    def _on_deliver(self, header: headers.Deliver, body: bytes) -> None:
        if header.delivery in self.open_deliveries:
            return  # after a reconnect central repeats deliveries it is not sure of
        if (reply := self._replies.get(header.delivery)) is not None:
            self.outgoing.append(
                reply
            )  # it may have been lost: with the power of central's computer, after it came
            return
        # Central knows of so many without an answer; it has got the answers of all before these.
        self._keep_replies(max(0, header.ahead - len(self.open_deliveries)))
        self.open_deliveries.add(header.delivery, is_suspended=header.suspended)
        (self.ahead if header.ahead else self.deliveries).append((header, body))

    def _on_taken(self, header: headers.Taken, _: bytes) -> None:
        lock = self._locks.pop(header.number, None) or self.requests.get(header.number)
        if (
            lock is not None
        ):  # the answer that grants it may have been lost, and comes again after this
            lock.taken = header.text

    def _on_replace(self, header: headers.Replace, _: bytes) -> None:
        if self.replace_slot is not None:
            self.replace_slot(header.number, header.text)

    def _on_unknown(self, header: headers.Unknown, _: bytes) -> None:
        if (request := self.requests.get(header.number)) is not None:
            # it was not done; and if sent only once, by nobody else
            request.was_sent = request.repeated
        if self.is_welcome:
            self.break_off()

    def _on_closing(self, header: headers.Closing, _: bytes) -> None:
        if not self._hello.connection:  # one of the module's connections says it for all
            self.complaints.append(
                f"central ends: {header.text}" if header.text else "central ends"
            )
        self.break_off()

    _ON: ClassVar[dict[type, Callable[["Session", Any, bytes], None]]] = {
        headers.Welcome: _on_welcome,
        headers.Accepted: _on_accepted,
        headers.TasksMade: _on_tasks_made,
        headers.Refused: _on_refused,
        headers.Answer: _on_answer,
        headers.Deliver: _on_deliver,
        headers.Cancelled: lambda self, header, _: self.open_deliveries.kill(
            header.delivery, header.why
        ),
        headers.Suspended: lambda self, header, _: self.open_deliveries.suspend(
            header.delivery, is_suspended=header.is_suspended
        ),
        Requested: lambda self, header, body: self.news.extend(
            self.open_deliveries.request(header, body)
        ),
        headers.Recall: lambda self, header, _: self.give_back(header.deliveries),
        headers.Taken: _on_taken,
        headers.Replace: _on_replace,
        headers.Beat: lambda *_: None,
        headers.Unknown: _on_unknown,
        headers.Closing: _on_closing,
        Route: lambda self, header, _: self.routing.append(header),
        EntranceGone: lambda self, header, _: self.routing.append(header),
        Barred: lambda self, header, _: self.routing.append(header),
    }
    """One row per message from central."""
