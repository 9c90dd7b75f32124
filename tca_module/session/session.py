"""One connection's side of the protocol, without I/O: requests, their repetition, and deliveries.

Headers go in through ``receive`` and come out in ``outgoing``. The caller passes the time. Until
central's Welcome, only Hello leaves. A numbered request is retained until its answer arrives. After
a break, open requests are repeated in order. Central recognises the number of a request and never
carries it out twice. Statements (informs, broadcasts, variable changes without a number) may be
lost.

A Welcome with another epoch means that central was restarted and has lost its tree. Open requests
are lost too, with two exceptions. The first: requests that name nothing of the old tree and only
ask about the present state. The second: requests that certainly never reached the old central. Such
a request did not leave, or it left once and the answer was Unknown. Messages and handlers are
declared again (``redeclaration``).
"""

from collections import deque
from collections.abc import Callable, Collection
from typing import Any
from weakref import WeakValueDictionary

import msgspec

from tca_module.session.epoch_numbers import RESTARTED, EpochNumber, first_foreign, numbers_in
from tca_module.session.joined_replies import HeldReplies, Item
from tca_module.session.lasting_attachments import LastingAttachments, is_lasting
from tca_module.session.open_requests import OpenRequests
from tca_module.session.redeclaration import Redeclaration
from tca_module.session.registering import register_headers
from tca_module.session.request import (
    HARMLESS,
    Request,
    check_fields,
    is_for_any_central,
    refers_to_tasks,
)
from tca_wire.packets import headers
from tca_wire.packets.changes import Observe, Requested
from tca_wire.packets.parts import HandlerFormat, MessageFormat
from tca_wire.text.measures import numbered
from tca_wire.vocabulary import Outcome, Refusal

HELLO_NUMBER = 1  # the number of every Hello, also of a repeated one
QUIET = 2.5  # seconds of silence after which a connection that waits for central probes it
IDLE = 45.0  # the same for an idle connection; central sends it a heartbeat every 30 seconds
REPEAT = 1.0  # seconds between two probes
CONFIRM_EVERY = 100  # unconfirmed statements after which central is probed
PREFETCH = 256  # messages that a slot may prefetch
UNBROKEN = 0.05  # seconds within which no broken line comes back
# replies to repeat after a break; a later delivery shows that older replies have arrived
_REPLIES_RETAINED = PREFETCH + 8

# The probe. It declares nothing, so it changes nothing. Central answers it with Accepted, or with
# Unknown if Hello must be sent again.
_PROBE = headers.Register(0, [], [])

_STATEMENTS = headers.Send | headers.SetVariable
"""The headers that are statements if they have no number."""


def quiet_within(patience: float, *, is_idle: bool = False) -> float:
    """Return the seconds of silence after which to probe central, given a wait's patience."""
    return min(IDLE if is_idle else QUIET, 0.75 * patience)


class Session(OpenRequests):
    """The state of one connection to central."""

    #: opens another slot in place of a hanging slot
    replace_slot: Callable[[int, str], object] | None = None

    def __init__(self, hello: headers.Hello, attachments: LastingAttachments | None = None) -> None:
        """*attachments*: the attachments of the module, if it has several connections.

        After a restart of central, the module's first connection makes them again.
        """
        super().__init__(HELLO_NUMBER)
        self._hello = msgspec.structs.replace(hello, number=HELLO_NUMBER)
        self.messages: dict[str, MessageFormat] = {}  #: name -> declared message, to declare again
        self._handlers: dict[str, HandlerFormat] = {}
        #: central knows that the module has made all attachments of its start
        self._is_ready = False
        #: granted locks that the program still refers to
        self._locks: WeakValueDictionary[int, Request] = WeakValueDictionary()
        self._replies: dict[int, tuple[headers.Reply | headers.Fail, bytes]] = {}
        """Delivery -> its reply, oldest first: replies that central may not have received."""
        self._probed_at = float("-inf")  #: when central was last probed
        self.probed_since = float("-inf")  #: when the first probe without an answer was sent
        self.heard = float("-inf")  #: when the last packet from central arrived
        #: replies in ``outgoing`` that leave together when their turn ends
        self.held_replies = HeldReplies()
        #: deliveries to handle now, even within a wait
        self.deliveries: deque[tuple[headers.Deliver, bytes]] = deque()
        #: prefetched deliveries, to handle after all earlier ones
        self.prefetched: deque[tuple[headers.Deliver, bytes]] = deque()
        #: the newest probe because of prefetched messages
        self._recheck: Request | None = None
        self.dropped = 0  #: number of statements that never left
        self.doubtful = 0  #: number of statements that were on their way when a connection broke
        self._arrived = 0  #: number of statements that central has received
        self._confirmation: Request | None = None  #: the newest probe by ``confirm``, if any
        self._replies_to_confirm: list[int] = []  #: the deliveries answered before that probe
        self.breaks = 0  #: how often the connection has broken
        #: central must learn that the module handles nothing more; set by any thread
        self.is_to_withdraw = False
        self.module = hello.module  #: the name under which central knows the module
        self.attachments = LastingAttachments() if attachments is None else attachments
        own = LastingAttachments() if hello.connection else self.attachments
        self.redeclaration = Redeclaration(
            own, self.request, self.complaints.append, self._declare_handlers
        )

    # --- calls of the module ----------------------------------------------------------------------

    def request(self, header: Any, body: bytes = b"", *, wants_answer: bool = False) -> Request:
        """Make a numbered request to central. Raises MisuseError if central could not read it."""
        check_fields(header)
        self.return_before_claim(header)
        return self.ask(header, body, wants_answer=wants_answer)

    def post(self, header: headers.ToCentral, body: bytes = b"") -> bool:
        """Send a header that has no answer. Returns False if it is lost: central is away."""
        is_statement = isinstance(header, _STATEMENTS)
        if not self.is_welcome:
            self.dropped += is_statement
            return False
        self.outgoing.append((header, body))
        if is_statement:
            self._posted += 1
            if self.unconfirmed >= CONFIRM_EVERY and (
                self._confirmation is None or self._confirmation.is_over
            ):
                self.confirm()
        return True

    def confirm(self) -> None:
        """Probe central: the answer shows that everything sent before has arrived."""
        self._confirmation, self._replies_to_confirm = self.probe(), list(self._replies)

    def probe(self) -> Request:
        """Probe central. The answer comes after everything that central has sent before."""
        return self.request(_PROBE)

    @property
    def incarnation(self) -> str:
        """The run of the module to which the connection belongs."""
        return self._hello.incarnation

    @property
    def unconfirmed(self) -> int:
        """The number of statements on this connection that may not have reached central."""
        return self._posted - self._arrived

    @property
    def lost(self) -> int:
        """The number of messages that are lost, or may be.

        A lost statement never left, or was on its way when a connection broke. A lost task may not
        have reached a central that ended.
        """
        return self.dropped + self.doubtful + len(self.sends.lost)

    @property
    def is_confirmed(self) -> bool:
        """Whether central has received everything that was sent."""
        return self.is_welcome and not (
            self.unconfirmed or self._replies or self.sends.unacknowledged
        )

    def pop_outgoing(self, clock: Callable[[], float]) -> list[Item]:
        """Remove and return the items to send."""
        outgoing, self.outgoing = self.outgoing, []
        return self.held_replies.joined(outgoing, clock()) if self.held_replies.ended else outgoing

    def reply(self, header: headers.Reply | headers.Fail, body: bytes, now: float = 0.0) -> bool:
        """Send the outcome of a handler, unless central has forgotten the delivery.

        Returns whether the reply is held back until its turn has ended.
        """
        if not self.open_deliveries.remove(header.delivery):
            return False
        refusals, errors = self.sends.pop_refusals(header.delivery)
        self.complaints += errors
        if refusals and isinstance(header, headers.Reply):
            header = msgspec.structs.replace(header, refusals=refusals)
        self._replies[header.delivery] = (header, body)
        self._drop_old_replies(_REPLIES_RETAINED)
        if not self.is_welcome:
            return False
        self.outgoing.append((header, body))
        return self.held_replies.hold(header, now)

    def postpone(self, header: headers.Postpone) -> None:
        """Report that a handler has returned, and replies later."""
        if header.delivery in self.open_deliveries:
            self.open_deliveries.postponed[header.delivery] = header
            if self.is_welcome:
                self.outgoing.append((header, b""))

    def _drop_old_replies(self, number: int) -> None:
        """Forget all but the newest replies; central has received the others."""
        while len(self._replies) > number:
            del self._replies[next(iter(self._replies))]

    @property
    def may_begin_next(self) -> bool:
        """Whether a prefetched message may begin: no handler runs, and the module does not end."""
        is_free = bool(self.prefetched) and self.open_deliveries.occupying == len(self.prefetched)
        return is_free and not self.open_deliveries.is_ending()

    @property
    def can_begin_next(self) -> bool:
        """Whether a prefetched message may begin, and central has answered the newest recheck."""
        return self.may_begin_next and (self._recheck is None or self._recheck.is_over)

    def recheck_prefetched(self) -> None:
        """Let no prefetched message begin before central answers a probe.

        After a pause of ``UNBROKEN`` seconds, the line may be a new one. Central may have given the
        messages to another slot, or their resource to the holder of a lock.
        """
        if self.prefetched and (self._recheck is None or self._recheck.is_over):
            self._recheck = self.probe()

    @property
    def is_claiming(self) -> bool:
        """Whether a claim is being requested or given up.

        Prefetched messages may have to wait for that claim.
        """
        return any(
            isinstance(one.header, headers.Lock | headers.GiveUp) for one in self.requests.values()
        )

    def return_before_claim(self, header: headers.ToCentral) -> None:
        """Return the prefetched messages to central before a claim, which might wait for them.

        If a callback makes the claim, the next prefetched message stays here, unless central
        recalls it.
        """
        if isinstance(header, headers.Lock) and self.prefetched:
            retained = [self.prefetched.popleft()] if self.may_begin_next else []
            self.return_prefetched()
            self.prefetched.extend(retained)

    def return_prefetched(self, recalled: Collection[int] | None = None) -> None:
        """Return prefetched deliveries to central: those in *recalled*, or all."""
        numbers = [header.delivery for header, _ in self.prefetched]
        returned = [number for number in numbers if recalled is None or number in recalled]
        self.prefetched = deque(one for one in self.prefetched if one[0].delivery not in returned)
        for delivery in returned:
            self.open_deliveries.remove(delivery)
        self.post(headers.Recalled(returned, is_answer=recalled is not None))

    def add_declared(
        self,
        messages: list[MessageFormat],
        handlers: list[HandlerFormat],
        *,
        is_ready: bool = False,
    ) -> None:
        """Remember declarations that central has accepted, to repeat them after a restart."""
        self.messages.update({message.name: message for message in messages})
        self._handlers.update({handler.message: handler for handler in handlers})
        self._is_ready |= is_ready

    def forget_handlers(self) -> None:
        """Forget the handlers and attachments, because this module handles nothing more."""
        self._handlers.clear()
        self.attachments.clear()

    # --- the connection ---------------------------------------------------------------------------

    def send_due(self, now: float, since: float, quiet: float = QUIET) -> float:
        """Send a probe or Hello if it is due; return when to call this again if nothing arrives.

        After *quiet* seconds of silence, central is probed every second. Silence counts at the
        earliest from *since*, the time at which the caller started to listen.
        """
        if self.is_to_withdraw:
            self.is_to_withdraw = False
            self.forget_handlers()
            self.request(headers.Unregister(0, []))
        is_restless = self.is_welcome and self.redeclaration.is_restless
        due = self.redeclaration.send_due(now) if is_restless else float("inf")
        probe_at = max(self.heard, since) + quiet if self.is_welcome else self._probed_at + REPEAT
        if self.heard < self._probed_at:
            probe_at = max(probe_at, self._probed_at + REPEAT)
        if now >= probe_at:
            if self.heard >= self._probed_at:
                self.probed_since = now
            self._probed_at, probe_at = now, now + REPEAT
            self.outgoing.append((_PROBE if self.is_welcome else self._hello, b""))
        return min(probe_at, due)

    def set_pulse(self, pulse: bytes) -> None:
        """Introduce this connection with another pulse from now on."""
        self._hello = msgspec.structs.replace(self._hello, pulse=pulse)

    def break_off(self) -> None:
        """Start again with Hello, because the connection broke or central does not know it."""
        self.breaks += 1
        self.is_welcome = False
        unsent = 0
        for header, _ in self.outgoing:
            unsent += isinstance(header, _STATEMENTS) and not header.number
            if (request := self.requests.get(getattr(header, "number", 0))) is not None:
                request.was_sent = request.was_repeated
        self.dropped += unsent
        self.doubtful += self.unconfirmed - unsent
        self._arrived = self._posted
        self.outgoing.clear()
        self.held_replies.clear()
        for header, _ in self.prefetched:  # central delivers it again
            self.open_deliveries.remove(header.delivery)
        self.prefetched.clear()
        self._probed_at = float("-inf")

    def receive(self, header: headers.ToModule, body: bytes, now: float) -> None:
        """Process a header from central."""
        self.heard = now
        _ON[type(header)](self, header, body)

    def _on_welcome(self, header: headers.Welcome, _: bytes) -> None:
        was_welcomed, is_new_epoch = bool(self.epoch), header.epoch != self.epoch
        if self.is_welcome:
            if not is_new_epoch:
                return  # Hello was sent twice
            self.break_off()  # the second Hello reached a restarted central
        self.epoch, self.module, self.refused = header.epoch, header.module, None
        if was_welcomed and is_new_epoch:
            self._forget()
            self._renew()
        self.is_welcome = True
        has_declared = self.messages or self._handlers or self._is_ready
        if was_welcomed and has_declared and (self.redeclaration.is_over or not is_new_epoch):
            is_over, messages = self.redeclaration.is_over, list(self.messages.values())
            handlers = list(self._handlers.values()) if is_over else []
            # Without a number, because a new number would be higher than those of the requests
            # repeated below. Central counts all requests below its highest number as answered.
            self._declare(messages, handlers, is_ready=is_over and self._is_ready)
        if was_welcomed and not is_new_epoch:
            self._repeat_declarations()
            self._observe_again()
        for request in self.requests.values():
            request.was_repeated = request.was_sent
            # A repeated send needs an answer of its own.
            if request.what and isinstance(request.header, headers.Send):
                request.header = msgspec.structs.replace(request.header, quiet=False)
            self._send(request)
        self.outgoing += [(one, b"") for one in self.open_deliveries.postponed.values()]
        self.outgoing += self._replies.values()

    def _repeat_declarations(self) -> None:
        """Declare the handlers that central may have accepted and forgotten with the connection.

        Repeating the request is not enough, because central would only repeat its first answer.
        """
        for header in [request.header for request in self.requests.values() if request.was_sent]:
            if isinstance(header, headers.Register) and (header.handlers or header.is_ready):
                self.outgoing.append((msgspec.structs.replace(header, number=0), b""))

    def _observe_again(self) -> None:
        """Observe again under new numbers.

        Changes that central sent during the break are lost. The new observation starts with the
        present state.
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
        """Redeclare to a restarted central before anything else, under the lowest numbers."""
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
            (header, b"") for header in register_headers(messages, handlers, is_ready=is_ready)
        ]

    def _forget(self) -> None:
        """Drop everything that belongs to the tree of a central that was restarted."""
        for number, request in list(self.requests.items()):
            if request.on_over is not None:
                del self.requests[number]  # ``redeclaration`` starts again and makes a new request
                continue
            subject = first_foreign(numbers_in(request.header), self.epoch)
            if subject is not None or refers_to_tasks(request.header):
                request.forgotten_subject = subject.what if subject is not None else ""
                self.finish(request, RESTARTED)
            elif request.was_sent and not is_for_any_central(request.header):
                self.finish(request, "central was restarted and has forgotten it")
            elif isinstance(request.header, Observe):
                request.answers.clear()  # about tasks of the old tree
        for lock in self._locks.values():
            lock.why_lock_lost = "central was restarted and has forgotten it"
        self._locks.clear()
        self._replies.clear()
        self.open_deliveries.forget()
        self.sends.forget()
        self.deliveries.clear()
        self.prefetched.clear()

    def _confirm_arrival(self, number: int) -> Request | None:
        """Return the request that central has answered. Record that all earlier sends arrived."""
        request = self.requests.get(number)
        if request is not None:
            self._arrived = max(self._arrived, request.statements_before)
            if request is self._confirmation:
                for delivery in self._replies_to_confirm:
                    self._replies.pop(delivery, None)
        return request

    def _on_accepted(self, header: headers.Accepted, _: bytes) -> None:
        request = self._confirm_arrival(header.number)
        was_not_sent = (
            request is not None and isinstance(request.header, headers.Send) and not header.id
        )
        if request is not None and (was_not_sent or not request.wants_answer):
            asked = request.header
            what = numbered(
                asked.message if isinstance(asked, headers.Send) else "number", header.id
            )
            request.accepted = number = EpochNumber(header.id, self.epoch, what)
            if request.on_over is None and is_lasting(asked):
                self.attachments.add(asked, self.messages, number)
            self.finish(request)

    def _on_tasks_made(self, header: headers.TasksMade, _: bytes) -> None:
        for number, task in header.tasks:
            self._on_accepted(headers.Accepted(number, task), b"")

    def _on_refused(self, header: headers.Refused, _: bytes) -> None:
        request = self._confirm_arrival(header.number)
        if header.refusal is Refusal.SHUT_OUT:
            self._on_not_welcome(header)
        elif request is None:
            if not self.is_welcome and (header.number == HELLO_NUMBER or not self.epoch):
                self._on_not_welcome(header)
            elif header.refusal is not Refusal.TOO_LATE:
                self.complaints.append(f"central refused: {header.text}")
            elif not header.number:  # a request with a number was given up in the meantime
                self.complaints.append(header.text)
        elif header.refusal is Refusal.TOO_LATE and request.was_repeated and request.wants_answer:
            self._ask_again(request)
        else:
            request.refused = header
            self.finish(request)

    def _on_not_welcome(self, header: headers.Refused) -> None:
        """End everything that waits for a central that refused Hello. Hello is repeated.

        The refusal has number 0 in two cases: central speaks another version and could not read
        Hello, or central no longer accepts this connection.
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
            lock.why_lock_lost = header.text
        self._locks.clear()

    def _ask_again(self, request: Request) -> None:
        """Repeat a request that central dropped when the connection broke."""
        if isinstance(request.header, HARMLESS):
            del self.requests[request.header.number]
            request.why_lock_lost, request.was_repeated = "", False
            self._number(request)
            self._send(request)
        else:
            # A query may have been answered, or a variable exchanged: the caller must decide.
            self.finish(request, "the connection to central broke before the answer came")

    def _on_answer(self, header: headers.Answer, body: bytes) -> None:
        request = self._confirm_arrival(header.number)
        if request is not None:
            request.answers.append((header, body))
            if not header.more:
                if isinstance(request.header, headers.Lock) and header.outcome is Outcome.DONE:
                    self._locks[header.number] = request
                self.finish(request)
            else:
                request.answers_seen += 1
                self._notify_waiters(request)

    def _on_deliver(self, header: headers.Deliver, body: bytes) -> None:
        if header.delivery in self.open_deliveries:
            return  # after a reconnect, central repeats unconfirmed deliveries
        if (reply := self._replies.get(header.delivery)) is not None:
            # The reply may be lost, for example with the power of central's computer.
            self.outgoing.append(reply)
            return
        # Central counts *ahead* deliveries as unanswered, so it has received all older replies.
        self._drop_old_replies(max(0, header.ahead - len(self.open_deliveries)))
        self.open_deliveries.add(header.delivery, is_suspended=header.suspended)
        (self.prefetched if header.ahead else self.deliveries).append((header, body))

    def _on_taken(self, header: headers.Taken, _: bytes) -> None:
        lock = self._locks.pop(header.number, None) or self.requests.get(header.number)
        # If the answer that granted the lock was lost, the request is still open.
        if lock is not None:
            lock.why_lock_lost = header.text

    def _on_replace(self, header: headers.Replace, _: bytes) -> None:
        if self.replace_slot is not None:
            self.replace_slot(header.number, header.text)

    def _on_unknown(self, header: headers.Unknown, _: bytes) -> None:
        if (request := self.requests.get(header.number)) is not None:
            # This central did not carry out the request. If it was sent only once, no earlier
            # central did either.
            request.was_sent = request.was_repeated
        if self.is_welcome:
            self.break_off()

    def _on_closing(self, header: headers.Closing, _: bytes) -> None:
        if not self._hello.connection:  # only the module's own connection logs central's end
            self.complaints.append(
                f"central ends: {header.text}" if header.text else "central ends"
            )
        self.break_off()


# ruff: noqa: SLF001 - the methods are named after their class, as mypyc demands (decision 128)
_ON: dict[type, Callable[[Session, Any, bytes], None]] = {
    headers.Welcome: Session._on_welcome,
    headers.Accepted: Session._on_accepted,
    headers.TasksMade: Session._on_tasks_made,
    headers.Refused: Session._on_refused,
    headers.Answer: Session._on_answer,
    headers.Deliver: Session._on_deliver,
    headers.Cancelled: lambda self, header, _: self.open_deliveries.kill(
        header.delivery, header.why
    ),
    headers.Suspended: lambda self, header, _: self.open_deliveries.suspend(
        header.delivery, is_suspended=header.is_suspended
    ),
    Requested: lambda self, header, body: self.pending_calls.extend(
        self.open_deliveries.request(header, body)
    ),
    headers.Recall: lambda self, header, _: self.return_prefetched(header.deliveries),
    headers.Taken: Session._on_taken,
    headers.Replace: Session._on_replace,
    headers.Beat: lambda *_: None,
    headers.Unknown: Session._on_unknown,
    headers.Closing: Session._on_closing,
}
"""The method that processes each type of header from central."""
