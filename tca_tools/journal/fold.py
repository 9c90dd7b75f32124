"""Folds the facts of a journal into what was known at a moment: tasks, messages, modules and their
doings.

Pure, and O(1) for each fact. It re-runs no rule of central, and takes any facts: a journal may
begin in the middle.
"""

import gc
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from math import inf, nextafter
from sys import intern

from tca_tools.journal.fold_records import RecordFold
from tca_tools.journal.journals import Log
from tca_tools.journal.records import (
    PLACES_OF,
    Claim,
    Drop,
    Failure,
    HandlerWait,
    Handling,
    Hold,
    Message,
    Offer,
    Queueing,
    Raised,
    Task,
    added,
    first_moment,
)
from tca_wire.constraints import Constraint
from tca_wire.journal import facts
from tca_wire.journal.causes import Request
from tca_wire.journal.fact import MonitorFact, TaskFact
from tca_wire.journal.takers import takers
from tca_wire.points import ALL_MOMENTS, END_ACHIEVING, ROOT, Moment
from tca_wire.text.facts_in_words import called
from tca_wire.vocabulary import Dropping, Outcome, Role
from tca_wire.waits import WaitKind

_LARGE = 100_000
"""Entries."""


@contextmanager
def no_garbage() -> Iterator[None]:
    """A fold only adds: Python would look through all of it for garbage, again and again, and take
    twice the time.
    """
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


class History(RecordFold):
    """The history of a run until ``time``; ``apply`` is the only way it changes."""

    def __init__(self) -> None:
        super().__init__()
        self._deliveries: dict[int, Handling] = {}
        self._queued: dict[int, Queueing] = {}
        self._running: dict[tuple[str, str], dict[int, Handling]] = {}
        self._reply_waits: dict[int, HandlerWait] = {}
        self._claim_waits: dict[int, HandlerWait] = {}
        self._task_waits: dict[tuple[str, int, int, str, str], list[HandlerWait]] = {}
        self._offered: dict[tuple[str, str], Offer] = {}

    @classmethod
    def until(cls, entries: Iterable[facts.Entry], time: float | None = None) -> "History":
        """The history as known at *time* (None: at the end); later entries are not even read."""
        history = cls()
        with no_garbage():
            for entry in entries:
                if time is not None and entry.time > time:
                    history.until_time = time
                    history.time = max(
                        history.time, time
                    )  # of several entries at that time the last is a bit later
                    break
                history.apply(entry)
            if len(history.times) > _LARGE:
                gc.freeze()  # to look through it takes seconds, and there is next to no garbage in it
        return history

    def extend_to(self, present: float | None, time: float | None = None) -> None:
        """Nothing more has happened until the *present* on the run's clock (None: the run is over);
        what goes on does so until then, or until *time* if that comes first.
        """
        if present is None or self.until_time is not None:
            return
        self.is_live = time is None or time >= present
        self.time = max(self.time, present if time is None else min(time, present))

    def apply(self, entry: facts.Entry) -> None:
        """Take in the facts that one event caused."""
        self.news.clear()
        cause = entry.cause
        request = cause if type(cause) is Request else None
        self.asker = self._deliveries.get(request.origin) if request and request.origin else None
        self._tick(entry, self.asker or (request.module if request else ""))
        for fact in entry.facts:
            take = _TAKE.get(type(fact))
            if take and not _is_of_root(fact):
                take(self, fact)
        for task in self._touched.values():
            if task.enter(task.state, self.time):
                self.news.append(task)
        self._touched.clear()

    def _tick(self, entry: facts.Entry, asker: Handling | str) -> None:
        """Each entry has a time of its own, however fast they follow each other: a time is a place
        in the journal.
        """
        if (
            self.numbers and entry.number == self.numbers[-1]
        ):  # an event of so many facts takes several records
            self.memo.clear()
            return
        self.time = (
            entry.time if entry.time > self.time or not self.times else nextafter(self.time, inf)
        )
        self.times.append(self.time)
        self.clock.append(entry.time)
        self.numbers.append(entry.number)
        self.asked_by.append(asker)

    # --- changes by each fact ---------------------------------------------------------------------

    def _opened(self, fact: facts.Opened) -> None:
        if self.began is None:
            self.began = fact.began
        self.epoch = fact.epoch

    def _joined(self, fact: facts.ModuleJoined) -> None:
        module = self._module(fact.module)
        if not module.joined or module.joined[-1][1] is not None:
            module.joined.append((self.time, None))
            self.news.append(module)

    def _left(self, fact: facts.ModuleLeft) -> None:
        module = self._module(fact.module)
        if module.joined and module.joined[-1][1] is None:
            module.joined[-1] = (module.joined[-1][0], self.time)
            self.news.append(module)
            module.left = fact.why
        for resource in ("", *module.resources):
            for handling in self._running.pop((fact.module, resource), {}).values():
                self._end(handling)

    def _resource(self, fact: facts.ResourceChanged) -> None:
        module = self._module(fact.module)
        module.resources[fact.resource] = fact.capacity
        module.sizes.setdefault(fact.resource, []).append((self.time, fact.capacity))
        self.news.append(module)
        module.capacities[fact.resource] = max(
            fact.capacity, module.capacities.get(fact.resource, 0)
        )

    def _format(self, fact: facts.FormatDefined) -> None:
        self.formats.setdefault(fact.message, fact)

    def _handler(self, fact: facts.HandlerAdded) -> None:
        known = self._offered.get((fact.message, fact.module))
        if known is None or (known.resource, known.accepts) != (fact.resource, fact.accepts):
            self._withdraw(fact.message, fact.module)
            offer = Offer(fact.module, fact.resource, self.time, accepts=fact.accepts)
            self._offered[fact.message, fact.module] = offer
            self.offers.setdefault(fact.message, []).append(offer)

    def _no_handler(self, fact: facts.HandlerRemoved) -> None:
        self._withdraw(fact.message, fact.module)

    def _withdraw(self, message: str, module: str) -> None:
        if offer := self._offered.pop((message, module), None):
            offer.end = self.time

    def _received(self, fact: facts.Received) -> None:
        if fact.id <= 0 or fact.id in self.messages:
            return
        name, sender = intern(fact.message), intern(fact.sender)
        known = fact.id, name, fact.message_class, sender, fact.origin, self.time, fact.body
        by = self._deliveries.get(fact.origin)
        by = (
            by if by is not None and by.message_id < fact.id else None
        )  # whoever sends is older than what he sends
        if fact.message_class.is_task:
            self._plant(Task(*known, role=fact.role, about=fact.about, parent=fact.parent, by=by))
            self._constrain(fact.constraints)
        else:
            self.messages[fact.id] = Message(*known, role=fact.role, about=fact.about, by=by)
        if fact.role is Role.CONDITION:
            self.conditions.setdefault(fact.about, self.messages[fact.id])
        if by is not None and fact.message_class.has_reply:
            by.asked = by.asked or []
            by.asked.append(self.messages[fact.id])
        if fact.blocking and not fact.message_class.is_task:
            self._await_reply(self.messages[fact.id])

    def _constrained(self, fact: facts.Constrained) -> None:
        self._constrain(fact.constraints)

    def _constrain(self, constraints: list[Constraint]) -> None:
        for constraint in constraints:
            if constraint.after.task in self.tasks:
                self._hold(self.tasks[constraint.after.task], Hold(constraint, self.time))

    def _queue(self, fact: facts.Queued) -> None:
        self._finish(fact.id)  # its handler left, and it waits for the next
        self._unqueue(fact.id)
        if fact.id != fact.message_id:
            self.message_of[fact.id] = fact.message_id
        message = self.tasks.get(fact.message_id) or self.messages.get(fact.id)
        place = intern(fact.module), intern(fact.resource)
        number = message.id if message and fact.id == fact.message_id else fact.message_id
        queueing = Queueing(number, *place, self.time, priority=fact.priority)
        self._queued[fact.id] = queueing
        self.queueings.append(queueing)
        self.news.append(queueing)
        if message:
            message.queueings = added(message.queueings, queueing)
            self._touch(message.id)
        else:
            self.copies.setdefault(fact.message_id, []).append(queueing)
            self._touch(fact.message_id)

    def _leave_queue(self, fact: facts.Unqueued) -> None:
        self._finish(fact.id)  # its handler left, and it may not wait for the next yet
        self._unqueue(fact.id)

    def _unqueue(self, delivery: int, end: float | None = None) -> Queueing | None:
        if queueing := self._queued.pop(delivery, None):
            queueing.end = self.time if end is None else end
            self.news.append(queueing)
            self._touch(queueing.message_id)
        return queueing

    def _deliver(self, fact: facts.Delivered) -> None:
        self._finish(fact.id)
        where = intern(fact.module), intern(fact.resource)
        if (there := self._running.get(where)) is None:
            there = self._running[where] = {}
            self._module(fact.module).resources.setdefault(fact.resource, 1)
        runs = self.runs.setdefault(where, [])
        start = self._start_of(fact, runs)
        self._unqueue(fact.id, start)
        if fact.id != fact.message_id:
            self.message_of[fact.id] = fact.message_id
        message = self.messages.get(fact.message_id)
        number, name = (
            (message.id, message.name) if message else (fact.message_id, self.name(fact.message_id))
        )
        handling = Handling(
            number,
            name,
            *where,
            start,
            delivery=number if fact.id == number else fact.id,
            beside=tuple(there.values()),
            slot=fact.slot,
            is_nested=fact.is_nested,
            priority=fact.priority,
        )
        there[handling.delivery] = self._deliveries[handling.delivery] = handling
        self.handlings.append(handling)
        self.news.append(handling)
        runs.append(handling)
        if message:
            self._begin_anew(message)
            message.handlings = added(message.handlings, handling)
            self._touch(message.id)
            if isinstance(message, Task):
                self._work_on(message, handling)

    def _start_of(self, given: facts.Delivered, runs: list[Handling]) -> float:
        """When a handler began: perhaps before central was told of it, but not before what was
        there before it.
        """
        if not given.began:
            return self.time
        before = [given.began, *(run.until for run in runs[-1:] if run.end is not None)]
        if queueing := self._queued.get(given.id):
            before.append(queueing.start)
        return min(self.time, max(before))

    def _return(self, fact: facts.Returned) -> None:
        if handling := self._finish(fact.id, fact.ended):
            task = self.tasks.get(handling.message_id)
            is_late = task is not None and task.killed is not None and fact.outcome is Outcome.DONE
            handling.outcome = Outcome.KILLED if is_late else fact.outcome
            if message := self.messages.get(handling.message_id):
                self._change(
                    message, "result" if fact.outcome is Outcome.DONE else "failure_data", fact.body
                )

    def _direct(self, fact: facts.HandledDirectly) -> None:
        end = min(max(0.0, fact.ended), self.time)  # before central was told of it
        start = min(max(0.0, end - fact.seconds), end)
        handling = Handling(0, fact.message, fact.module, fact.resource, start, end, fact.outcome)
        handling.direct_from = fact.sender
        handling.by = self._run_of(fact.origin, fact.sender)
        self.handlings.append(handling)
        self.news.append(handling)
        self._module(fact.module).resources.setdefault(fact.resource, 1)

    def _run_of(self, delivery: int, module: str) -> Handling | None:
        """The run of a module's handler that a delivery stood for: it may be over when central is
        told of that.
        """
        message = self.delivered(delivery)
        runs = reversed(message.handlings) if message else ()
        return next(
            (run for run in runs if run.delivery == delivery and run.module == module), None
        )

    def _finish(self, delivery: int, ended: float = 0) -> Handling | None:
        """The handler of a delivery no longer has it; *ended* is when it returned, if that was
        earlier.
        """
        if handling := self._deliveries.pop(delivery, None):
            self._running.get((handling.module, handling.resource), {}).pop(delivery, None)
            self._end(handling, ended)
        return handling

    def _end(self, handling: Handling, ended: float = 0) -> None:
        if handling.end is None:
            handling.end = min(self.time, max(ended, handling.start)) if ended else self.time
            self.news.append(handling)
            self._touch(handling.message_id)
        for wait in handling.waits[-1:]:
            self._stop_waiting(wait)

    def _reach(self, fact: facts.Reached) -> None:
        task = self._task(fact.task)
        times = task.times
        for place in PLACES_OF[fact.moments & ALL_MOMENTS]:
            if times[place] == inf:
                times[place] = self.time
        if fact.moments & END_ACHIEVING:
            self._end_suspension(task)
            self._end_recovery(task)

    def _fail(self, fact: facts.Failed) -> None:
        if not fact.is_beside:
            self._unqueue(fact.id)
        lost = (
            None if fact.is_beside else self._finish(fact.id)
        )  # of a module that was lost no handler returns
        if lost:
            lost.outcome, lost.is_lost = Outcome.FAILED, True
        failure = Failure(fact.failure, fact.text)
        if fact.is_beside:
            self.raised.setdefault(fact.id, []).append(
                Raised(self.time, failure, fact.by, self.asker)
            )
        if message := self.messages.get(lost.message_id if lost else fact.id):
            before = message.failure, message.failure_data
            self._change(message, "failure", failure)
            self._seen_to.pop(message.id, None)
            if fact.body:
                self._change(message, "failure_data", fact.body)
            if not fact.is_beside and isinstance(message, Task) and message.is_retried:
                self._forget_outcome(
                    message
                )  # but for what was raised on it since it is to be retried
                self._change(message, "failure", before[0])
                self._change(message, "failure_data", before[1])

    def _kill(self, fact: facts.Killed) -> None:
        task = self._task(fact.task)
        self._change(task, "killed", fact.why)
        self._change(task, "killed_by", fact.by)
        task.killer, task.killed_for = self._run_of(fact.origin, fact.by), fact.failed
        self._could_not_decide(fact.task)
        self._end_suspension(task)
        self._unqueue(fact.task)

    def _drop(self, fact: facts.Dropped) -> None:
        self._unqueue(fact.id)
        if (
            fact.id not in self.messages
        ):  # a copy, for a listener that left; who gave up a message may still handle it
            self._finish(fact.id)
        self._stop_waiting(self._reply_waits.pop(fact.id, None))
        number, is_copy = fact.copy_of or fact.id, fact.copy_of > 0
        self.drops.append(
            Drop(self.time, fact.message, 1, fact.why, number, is_copy, fact.dropping)
        )
        if message := self.messages.get(fact.id):
            circle = (
                self.deadlocks.get((self.time, message.sender), "")
                if fact.dropping is Dropping.DEADLOCK
                else ""
            )
            self._change(message, "dropped", circle or fact.why)
            message.dropping = fact.dropping

    def _lose_directly(self, fact: facts.LostDirectly) -> None:
        why = "its handler was too slow, left or died"
        self.drops.append(Drop(self.time, fact.message, fact.number, why, sender=fact.module))

    def _answer(self, fact: facts.Answered) -> None:
        self._stop_waiting(self._reply_waits.pop(fact.id, None))
        if message := self.messages.get(fact.id):
            message.answered = self.time

    def _await_answer(self, fact: facts.Awaited) -> None:
        """Whoever asked has gone on until now."""
        message = self.messages.get(fact.id)
        if message is not None and message.answered is None and fact.id not in self._reply_waits:
            self._await_reply(message)

    def _await_reply(self, query: Message) -> None:
        wait = HandlerWait(query.id, self.time)
        self._reply_waits[query.id] = self._wait(wait, query.sender, query.origin)

    def _wait_began(self, fact: facts.WaitBegan) -> None:
        moment = first_moment(fact.moment)
        if fact.awaits is WaitKind.CHANGE and fact.task:
            moment = Moment.END_ACHIEVING  # the last change
        begun = HandlerWait(fact.task, self.time, moment, kind=fact.awaits, name=fact.name)
        wait = self._wait(begun, fact.module, fact.origin)
        self._task_waits.setdefault(fact.key, []).append(wait)

    def _wait_ended(self, fact: facts.WaitEnded) -> None:
        waits = self._task_waits.pop(fact.key, [])
        if waits:
            self._stop_waiting(waits.pop())
        if waits:  # another thread of the module waits for the same
            self._task_waits[fact.key] = waits

    def _claimed(self, fact: facts.Claimed) -> None:
        known = (
            fact.id,
            fact.module,
            fact.resource,
            fact.is_reserved,
            fact.sender,
            fact.origin,
            self.time,
        )
        claim = self.claims[fact.id] = Claim(*known, by=self._deliveries.get(fact.origin))
        self.wanted.setdefault((called(fact.module), fact.resource), []).append(claim)
        self.news.append(claim)
        self._claim_waits[fact.id] = self._wait(
            HandlerWait(fact.id, self.time), fact.sender, fact.origin
        )

    def _granted(self, fact: facts.Granted) -> None:
        self._stop_waiting(self._claim_waits.pop(fact.id, None))
        if (claim := self.claims.get(fact.id)) is not None:
            claim.granted = self.time
            self.news.append(claim)
            self.grants.setdefault((called(claim.module), claim.resource), []).append(claim)

    def _claim_ended(self, fact: facts.ClaimEnded) -> None:
        self._stop_waiting(self._claim_waits.pop(fact.id, None))
        if (claim := self.claims.get(fact.id)) is not None:
            claim.end, claim.ended = self.time, fact.why
            self.news.append(claim)

    def _wait(self, wait: HandlerWait, module: str, origin: int) -> HandlerWait:
        """Note *wait* at the handler of delivery *origin*, or at the module where it runs outside
        of any.
        """
        handling = self._deliveries.get(origin)
        at = handling or self._module(module)
        at.waits = added(at.waits, wait)
        wait.by = handling or module
        self.news.append(wait)
        self._touch(handling.message_id if handling else 0)
        return wait

    def _stop_waiting(self, wait: HandlerWait | None) -> None:
        if wait and wait.end is None:
            wait.end = self.time
            self.news.append(wait)
            self._touch(wait.by.message_id if isinstance(wait.by, Handling) else 0)


_TAKE = takers(History, RecordFold)


def _is_of_root(fact: facts.Fact) -> bool:
    """Whether it says that something happened to the root: no central writes that."""
    if isinstance(fact, TaskFact):
        return fact.task <= ROOT
    return isinstance(fact, MonitorFact) and fact.monitor <= ROOT


def folded(
    journal: Log, time: float | None = None, entries: Iterable[facts.Entry] | None = None
) -> History:
    """The history as known at *time* (seconds on the run's clock; None: at the end, or now if the
    run goes on).

    *entries* are those of the journal, if somebody wants to see them on the way. Raises UnusableLog
    if there are none.
    """
    history = History.until(journal if entries is None else entries, time)
    history.extend_to(journal.present(history.time), time)
    return history
