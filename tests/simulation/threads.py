"""Modules as processes with threads. Each thread has a connection with the library's own session,
and runs handlers.

A handler is a generator. Each yielded value says how the handler spends its time. ``Busy``: its
thread receives nothing. ``Nap``: its thread receives and handles packets. A request, or ``Wait``:
its thread waits until the request is over. As in the library, a waiting thread handles messages
within the wait. A wait ends early when the task is killed.
"""

from collections import deque
from collections.abc import Callable, Generator
from typing import Any, NamedTuple

from simulation.clockwork import Clockwork, shown
from simulation.network import Network

from tca_module.session import given_up
from tca_module.session.lasting_attachments import LastingAttachments
from tca_module.session.open_deliveries import KILLED, OpenDelivery, working_on
from tca_module.session.request import Request
from tca_module.session.session import PREFETCH, UNBROKEN, Session, quiet_within
from tca_wire.packets import codec, headers

PATIENCE = 10.0
SEND_WAIT = 1.0
LATE = 0.02
FOR_EVER = float("inf")


class Busy(NamedTuple):
    """Time in which a thread does not listen."""

    seconds: float


class Nap(NamedTuple):
    """Time in which a thread listens."""

    seconds: float


class Wait(NamedTuple):
    """Time in which a thread waits for the answer to a request, up to a limit."""

    request: Request
    seconds: float


class Failing(Exception):
    """A failure that a handler raises."""

    def __init__(self, failure: str, *, reissue: bool = False) -> None:
        super().__init__(failure)
        self.failure, self.reissue = failure, reissue


class Woken(Exception):
    """The end of a wait without an answer: the task was killed, central is silent, or the time is
    over.
    """


class Lost(Exception):
    """The end of a wait for a request that was refused or lost."""

    def __init__(self, request: Request) -> None:
        refused = request.refused
        super().__init__(
            f"{refused.refusal}: {refused.text}" if refused is not None else request.why_lost
        )
        self.request = request


Steps = Generator[Busy | Nap | Wait | Request, None, Any]


class Work:
    """A running handler or main program."""

    __slots__ = (
        "began",
        "delivery",
        "open",
        "request",
        "session",
        "since",
        "steps",
        "thread",
        "until",
        "waits",
    )

    def __init__(self, thread: "Thread", delivery: headers.Deliver | None) -> None:
        self.thread = thread
        self.session = thread.session
        self.delivery = delivery
        self.open: OpenDelivery | None = None
        self.steps: Steps
        self.request: Request | None = None  #: the awaited request
        self.waits = False  #: whether its thread listens
        self.began = thread.now
        self.since = self.until = 0.0  #: start and limit of its wait


class Thread:
    """A thread of a module, with its connection."""

    def __init__(self, process: "Process", number: int, resource: str) -> None:
        self.process, self.number, self.resource = process, number, resource
        self.clockwork = process.clockwork
        self.name = f"{process.name}/{number}"
        prefetch = PREFETCH if resource else 0
        hello = headers.Hello(
            0,
            headers.PROTOCOL_VERSION,
            process.program.name,
            process.incarnation,
            number,
            resource,
            prefetch=prefetch,
        )
        self.session = Session(hello, process.attachments)
        self.session.open_deliveries.is_ending = lambda: process.is_leaving
        self.arrived: deque[bytes] = deque()
        self.stack: list[Work] = []
        self.is_over = False
        self._wake_at = FOR_EVER
        self._stuck_since = FOR_EVER  #: start of the time in which no packet leaves
        self.welcomed_at = 0.0  #: time of the last welcome
        self._since = self.clockwork.now
        self._lingers_until = FOR_EVER
        self.socket = process.network.open(self)
        self.advance()

    @property
    def now(self) -> float:
        return self.clockwork.now

    @property
    def is_busy(self) -> bool:
        """Whether the thread does not listen now."""
        return bool(self.stack) and not self.stack[-1].waits

    # --- the line ---------------------------------------------------------------------------------

    def receive(self, packet: bytes) -> None:
        """Accept a packet that arrives."""
        self.arrived.append(packet)
        if not self.is_busy:
            self.advance()

    def has_line(self) -> None:
        """Continue, because the line is connected again."""
        if not self.is_busy:
            self.advance()

    def flush(self) -> None:
        """Send the outgoing packets. After a second without success the line counts as broken."""
        session = self.session
        if not session.outgoing:
            return
        outgoing = session.pop_outgoing(lambda: self.now)
        for before, packet in codec.packets(outgoing):
            if not self.socket.send(packet):
                session.outgoing = outgoing[before:]
                session.recheck_prefetched()
                self._stuck_since = min(self._stuck_since, self.now)
                if self.now >= self._stuck_since + SEND_WAIT:
                    self._stuck_since = FOR_EVER
                    session.break_off()
                return
            self.clockwork.note(packet)
        self._stuck_since = FOR_EVER

    def catch_up(self) -> None:
        """Receive all arrived packets."""
        while self.arrived:
            self._receive(self.arrived.popleft())

    def _receive(self, packet: bytes) -> None:
        for header, body in codec.unpack_to_module(packet):
            if self.clockwork.has_trace_reader and not isinstance(header, headers.Beat):
                self.clockwork.trace(self.name, f"hears {shown(header)}")
            if isinstance(header, headers.Welcome):
                self.welcomed_at = self.now
            self.session.receive(header, body, self.now)
        while self.session.complaints:
            self.clockwork.trace(self.name, f"LOGS {self.session.complaints.pop(0)}")

    # --- its turns --------------------------------------------------------------------------------

    def advance(self) -> None:
        """Do everything that is possible now."""
        session = self.session
        while not (self.is_busy or self.is_over) and self._does_next():
            pass
        if self.is_over:
            return
        if self.is_busy:
            self.flush()
            return
        waits = bool(self.stack)
        quiet = quiet_within(PATIENCE if waits else FOR_EVER, is_idle=not waits)
        due = session.send_due(self.now, self.stack[-1].since if waits else self._since, quiet)
        self.flush()
        if session.outgoing or not session.is_welcome:
            due = min(due, self.now + 0.2)
        if waits:
            due = min(
                due, self.stack[-1].until, max(session.heard, self.stack[-1].since) + PATIENCE
            )
        self.wake(due)

    def _does_next(self) -> bool:
        """Do the first possible action. Return False if there is none."""
        session = self.session
        if self.arrived:
            self._receive(self.arrived.popleft())
        elif session.pending_calls:
            session.pending_calls.popleft()()
        elif self.stack and self._goes_on(self.stack[-1]):
            pass
        elif session.deliveries:
            self._begin(*session.deliveries.popleft())
        elif session.can_begin_next and not session.is_claiming and not self.stack:
            header, body = session.prefetched.popleft()
            session.held_replies.begin(header.delivery, self.now)
            self._begin(header, body)
            if self.is_busy or not session.may_begin_next:
                self._end_turn()
        else:
            return self.process.is_leaving and self._leaves()
        return True

    def _end_turn(self) -> None:
        if self.session.held_replies.ended and self.is_busy:
            self.clockwork.after(LATE, self._flush_late)  # as another thread of the library does
        else:
            self.flush()
        self.session.held_replies.stop()

    def _flush_late(self) -> None:
        if not self.is_over:
            self.flush()

    def wake(self, at: float) -> None:
        """Schedule another look."""
        if at < self._wake_at and at < FOR_EVER:
            self._wake_at = at
            self.clockwork.after(max(0.0, at - self.now), self._woken, at)

    def _woken(self, at: float) -> None:
        if at == self._wake_at:
            self._wake_at = FOR_EVER
            if not (self.is_over or self.is_busy):
                self.advance()

    # --- handlers ---------------------------------------------------------------------------------

    def run(self, main: Callable[[Work], Steps]) -> None:
        """Start the main program."""
        work = Work(self, None)
        work.steps = main(work)
        self.stack.append(work)
        self._go_on(work)
        self.advance()

    def _begin(self, header: headers.Deliver, body: bytes) -> None:
        work = Work(self, header)
        work.open = self.session.open_deliveries.begin(header.delivery, header.message)
        work.steps = self.process.program.handle(work, header, body)
        self.process.outside.begin(work, header, body)
        self.stack.append(work)
        self._go_on(work)

    def _goes_on(self, work: Work) -> bool:
        """Continue a handler whose wait is over. Return whether the wait was over."""
        request, session = work.request, self.session
        is_over = request.is_over if request is not None else False
        reason = (
            ""
            if request is None or not request.waits_for_others or work.open is None
            else (session.open_deliveries.wake_reason(work.open))
        )
        if reason and (
            not is_over or (reason == KILLED and request is not None and request.is_ended_by_kill)
        ):
            session.open_deliveries.mark_notified(work.open)
            self._give_up(work, reason)
        elif is_over:
            assert request is not None
            has_failed = request.refused is not None or request.why_lost
            self._go_on(work, Lost(request) if has_failed else None)
        elif self.now >= work.until:
            self._give_up(work, "time is over") if request is not None else self._go_on(work)
        elif self.now >= max(session.heard, work.since) + PATIENCE and request is not None:
            self._give_up(work, "central is silent")
        else:
            return False
        return True

    def _give_up(self, work: Work, why: str) -> None:
        if work.request is not None:
            given_up.abandon(self.session, work.request)
        self._go_on(work, Woken(why))

    def _go_on(self, work: Work, error: Exception | None = None) -> None:
        """Run a handler to its next step, or to its end."""
        work.request, work.waits, work.until = None, False, FOR_EVER
        failed: Failing | None = None
        body = b"\xc0"
        try:
            with working_on(work.open):
                step = next(work.steps) if error is None else work.steps.throw(error)
        except StopIteration as end:
            self._end(work, end.value or body)
        except Failing as failing:
            failed = failing
            self._end(work, body, failed)
        except (Woken, Lost) as let_pass:
            self.clockwork.trace(self.name, f"lets pass {type(let_pass).__name__}: {let_pass}")
            if work.delivery is None:
                self.process.fail()
            else:
                self._end(work, body, Failing("handler error"))
        else:
            self._do(work, step)

    def _do(self, work: Work, step: Busy | Nap | Wait | Request) -> None:
        work.since = self.now
        wait = step if isinstance(step, Wait) else None
        step = wait.request if wait is not None else step
        if isinstance(step, Request):
            work.request, work.waits = step, True
            work.until = self.now + wait.seconds if wait is not None else FOR_EVER
            if step.is_unannounced:
                step.is_announced = self.session.post(
                    headers.Await(step.header.number, True, step.header.origin)
                )
        else:
            work.waits = isinstance(step, Nap)
            work.until = self.now + step.seconds
            if isinstance(step, Busy):
                self.flush()
                self.clockwork.after(step.seconds, self._is_done, work)

    def _is_done(self, work: Work) -> None:
        """Continue a handler whose busy time is over."""
        if not self.is_over:
            self._go_on(work)
            self.advance()

    def _end(self, work: Work, body: bytes, failing: Failing | None = None) -> None:
        assert self.stack[-1] is work
        self.stack.pop()
        delivery = work.delivery
        if delivery is None:
            self.flush()
            self.process.main_ended()
            return
        reply: headers.Reply | headers.Fail = headers.Reply(
            delivery.delivery, self.now - work.began
        )
        if failing is None and self.session.open_deliveries.was_woken_to_end(delivery.delivery):
            failing = Failing("module lost")
        if failing is not None:
            reply, body = (
                headers.Fail(delivery.delivery, failing.failure, "why", [], failing.reissue),
                b"\x07",
            )
        self.process.outside.end(work, delivery, body, failing)
        with working_on(work.open):
            is_held = self.session.reply(reply, body, self.now)
        if not self.stack and self.now > work.began + UNBROKEN:
            self.catch_up()
            self.session.recheck_prefetched()
        if not is_held:
            self.flush()

    # --- its end ----------------------------------------------------------------------------------

    def _leaves(self) -> bool:
        """Say goodbye if no work is left. Return whether the thread did so."""
        if self.stack or (not self.number and self.process.has_slots):
            return False
        session = self.session
        if session.prefetched:
            session.return_prefetched()
        if self._lingers_until == FOR_EVER:
            self._lingers_until = self.now + PATIENCE
            if session.is_welcome and not session.is_confirmed:
                session.confirm()
        if session.is_welcome and not session.is_confirmed and self.now < self._lingers_until:
            self.wake(self._lingers_until)
            return False
        self.session.post(headers.Bye())
        self.flush()
        self.close()
        self.process.has_ended(self)
        return True

    def close(self) -> None:
        """End with the process."""
        self.is_over = True
        self.socket.close()


class Program:
    """The program of a module, the same in all its runs."""

    name = ""

    def handle(self, work: Work, header: headers.Deliver, body: bytes) -> Steps:
        """Handle a message."""
        raise NotImplementedError

    def begin(self, process: "Process", work: Work) -> Steps:
        """Run the main program: declare the handlers, open slots."""
        raise NotImplementedError


class Process:
    """One run of a module."""

    def __init__(
        self,
        clockwork: Clockwork,
        network: Network,
        outside: Any,
        program: Program,
        number: int,
        fail: Callable[[], None],
    ) -> None:
        self.clockwork, self.network, self.outside, self.program = (
            clockwork,
            network,
            outside,
            program,
        )
        self.fail = fail  #: called when the main program fails, to restart the process
        self.name = f"{program.name}.{number}"
        self.incarnation = f"run {number} of {program.name}"
        self.attachments = LastingAttachments()
        self.is_alive, self.is_leaving, self.has_finished = True, False, False
        self.threads: list[Thread] = []
        self.ended = 0
        clockwork.trace(self.name, "starts")
        first = Thread(self, 0, "")
        self.threads.append(first)
        first.run(lambda work: program.begin(self, work))

    @property
    def has_slots(self) -> bool:
        return any(not thread.is_over for thread in self.threads[1:])

    def open_slot(self, resource: str) -> None:
        """Open a further thread, which handles messages."""
        self.threads.append(Thread(self, len(self.threads), resource))

    def main_ended(self) -> None:
        self.has_finished = True

    def crash(self) -> None:
        """End all threads at once."""
        self.clockwork.trace(self.name, "CRASHES")
        self.is_alive = False
        for thread in self.threads:
            if not thread.is_over:
                thread.close()
        self.outside.die(self)

    def leave(self) -> None:
        """Leave: handle no further message, finish the running ones, say goodbye."""
        self.clockwork.trace(self.name, "leaves")
        self.is_leaving = True
        first = self.threads[0]
        first.session.forget_handlers()
        first.session.request(headers.Unregister(0, []))
        for thread in self.threads:
            if not thread.is_over and not thread.is_busy:
                thread.advance()

    def has_ended(self, thread: Thread) -> None:
        """Note that a thread has said goodbye. The first thread says goodbye last."""
        first = self.threads[0]
        if thread is first:
            self.is_alive = False
            self.outside.die(self)
        elif not self.has_slots and not first.is_busy:
            first.advance()
