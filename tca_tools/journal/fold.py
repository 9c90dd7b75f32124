"""Fold the facts of a journal into the records of a run: tasks, messages, modules and handlers.

Pure, and O(1) for each fact. The fold re-runs no rule of central and accepts facts in any order: a
journal may start in the middle of a run.
"""

import gc
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from math import inf, nextafter
from sys import intern

from tca_tools.journal.failure import Failure
from tca_tools.journal.fold_records import RecordFold
from tca_tools.journal.journals import Log
from tca_tools.journal.records import (
    PLACES_OF,
    Claim,
    Drop,
    HandlerWait,
    Handling,
    Hold,
    Message,
    Offer,
    Queueing,
    Raised,
    Task,
    first_moment,
)
from tca_tools.journal.sequences import appended
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
"""The number of entries from which a history is excluded from garbage collection."""


@contextmanager
def no_garbage() -> Iterator[None]:
    """Pause garbage collection: a fold makes no garbage, and collections double its time."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


class History(RecordFold):
    """The history of a run until ``time``; only ``apply`` and ``extend_to`` change it."""

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
        """Return the history as known at *time* (None: at the end); reads no later entries."""
        history = cls()
        with no_garbage():
            for entry in entries:
                if time is not None and entry.time > time:
                    history.until_time = time
                    # The last of several entries at one time counts as slightly later: see _tick
                    history.time = max(history.time, time)
                    break
                history.apply(entry)
            if len(history.times) > _LARGE:
                gc.freeze()  # a collection over so large a history takes seconds
        return history

    def extend_to(self, present: float | None, time: float | None = None) -> None:
        """Extend a live run to the present, since nothing has happened after its last entry.

        Args:
            present: The present on the run's clock; None if the run is over.
            time: The time at which the run is viewed, if that is before the present.
        """
        if present is None or self.until_time is not None:
            return
        self.is_live = time is None or time >= present
        self.time = max(self.time, present if time is None else min(time, present))

    def apply(self, entry: facts.Entry) -> None:
        """Apply the facts that one event caused."""
        self.news.clear()
        cause = entry.cause
        request = cause if type(cause) is Request else None
        self.asker = self._deliveries.get(request.origin) if request and request.origin else None
        self._tick(entry, self.asker or (request.module if request else ""))
        for fact in entry.facts:
            apply_fact = _METHODS.get(type(fact))
            if apply_fact and not _is_of_root(fact):
                apply_fact(self, fact)
        for task in self._touched.values():
            if task.enter(task.state, self.time):
                self.news.append(task)
        self._touched.clear()

    def _tick(self, entry: facts.Entry, asker: Handling | str) -> None:
        """Advance the time. Each entry gets a unique time, so a time identifies an entry."""
        # An event with many facts is written as several entries of the same number
        if self.numbers and entry.number == self.numbers[-1]:
            self.memo.clear()
            return
        is_later = entry.time > self.time or not self.times
        self.time = entry.time if is_later else nextafter(self.time, inf)
        self.times.append(self.time)
        self.clock.append(entry.time)
        self.numbers.append(entry.number)
        self.asked_by.append(asker)

    # --- each method applies all facts of one type ------------------------------------------------

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
                self._end_handling(handling)

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

    def _handler_removed(self, fact: facts.HandlerRemoved) -> None:
        self._withdraw(fact.message, fact.module)

    def _withdraw(self, message: str, module: str) -> None:
        if offer := self._offered.pop((message, module), None):
            offer.end = self.time

    def _received(self, fact: facts.Received) -> None:
        if fact.id <= 0 or fact.id in self.messages:
            return
        name, sender = intern(fact.message), intern(fact.sender)
        fields = fact.id, name, fact.message_class, sender, fact.origin, self.time, fact.body
        by = self._deliveries.get(fact.origin)
        # A sender has a smaller id than its messages. A journal may claim otherwise
        by = by if by is not None and by.message_id < fact.id else None
        if fact.message_class.is_task:
            self._plant(Task(*fields, role=fact.role, about=fact.about, parent=fact.parent, by=by))
            self._constrain(fact.constraints)
        else:
            self.messages[fact.id] = Message(*fields, role=fact.role, about=fact.about, by=by)
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
        self._finish(fact.id)  # the handler of the message left, and it waits for another one
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
            message.queueings = appended(message.queueings, queueing)
            self._touch(message.id)
        else:
            self.copies.setdefault(fact.message_id, []).append(queueing)
            self._touch(fact.message_id)

    def _leave_queue(self, fact: facts.Unqueued) -> None:
        self._finish(fact.id)  # the handler of the message left, and it is not queued again yet
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
        if (running := self._running.get(where)) is None:
            running = self._running[where] = {}
            self._module(fact.module).resources.setdefault(fact.resource, 1)
        handlings = self.by_resource.setdefault(where, [])
        start = self._start_of(fact, handlings)
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
            concurrent=tuple(running.values()),
            slot=fact.slot,
            is_nested=fact.is_nested,
            priority=fact.priority,
        )
        running[handling.delivery] = self._deliveries[handling.delivery] = handling
        self.handlings.append(handling)
        self.news.append(handling)
        handlings.append(handling)
        if message:
            self._start_again(message)
            message.handlings = appended(message.handlings, handling)
            self._touch(message.id)
            if isinstance(message, Task):
                self._work_on(message, handling)

    def _start_of(self, fact: facts.Delivered, handlings: list[Handling]) -> float:
        """Return when a handler started.

        The handler of a prefetched delivery starts before central writes the delivery's entry. It
        starts after the message was queued, and after the previous handling in the resource.
        """
        if not fact.began:
            return self.time
        bounds = [fact.began, *(one.until for one in handlings[-1:] if one.end is not None)]
        if queueing := self._queued.get(fact.id):
            bounds.append(queueing.start)
        return min(self.time, max(bounds))

    def _return(self, fact: facts.Returned) -> None:
        if handling := self._finish(fact.id, fact.ended):
            task = self.tasks.get(handling.message_id)
            is_late = task is not None and task.killed is not None and fact.outcome is Outcome.DONE
            handling.outcome = Outcome.KILLED if is_late else fact.outcome
            handling.transition = fact.transition
            if message := self.messages.get(handling.message_id):
                self._change(
                    message, "result" if fact.outcome is Outcome.DONE else "failure_data", fact.body
                )

    def _handling_of(self, delivery: int, module: str) -> Handling | None:
        """Return a module's handling of a delivery, whether it is running or has ended."""
        message = self.delivered(delivery)
        handlings = reversed(message.handlings) if message else ()
        return next(
            (one for one in handlings if (one.delivery, one.module) == (delivery, module)), None
        )

    def _finish(self, delivery: int, ended: float = 0) -> Handling | None:
        """End the run of a delivery's handler: at *ended* if that is given, else now."""
        if handling := self._deliveries.pop(delivery, None):
            self._running.get((handling.module, handling.resource), {}).pop(delivery, None)
            self._end_handling(handling, ended)
        return handling

    def _end_handling(self, handling: Handling, ended: float = 0) -> None:
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
            self._finish_recovery(task)

    def _fail(self, fact: facts.Failed) -> None:
        if not fact.is_beside:
            self._unqueue(fact.id)
        # The handler of a lost module does not return: its run ends here
        lost = None if fact.is_beside else self._finish(fact.id)
        if lost:
            lost.outcome, lost.is_lost = Outcome.FAILED, True
        failure = Failure(fact.failure, fact.text)
        if fact.is_beside:
            self.raised.setdefault(fact.id, []).append(
                Raised(self.time, failure, fact.by, self.asker)
            )
        if message := self.messages.get(lost.message_id if lost else fact.id):
            old_failure, old_data = message.failure, message.failure_data
            self._change(message, "failure", failure)
            self._undecided.pop(message.id, None)
            if fact.body:
                self._change(message, "failure_data", fact.body)
            if not fact.is_beside and isinstance(message, Task) and message.is_retry_due:
                # The outcome of the old run is void. A failure that was raised from outside the
                # handler since the retry was requested remains.
                self._forget_outcome(message)
                self._change(message, "failure", old_failure)
                self._change(message, "failure_data", old_data)

    def _kill(self, fact: facts.Killed) -> None:
        task = self._task(fact.task)
        self._change(task, "killed", fact.why)
        self._change(task, "killed_by", fact.by)
        task.killer, task.killed_for = self._handling_of(fact.origin, fact.by), fact.failed
        self._reopen_search(fact.task)
        self._end_suspension(task)
        self._unqueue(fact.task)

    def _drop(self, fact: facts.Dropped) -> None:
        self._unqueue(fact.id)
        # This is a copy for a listener that left. A message that was given up is still handled
        if fact.id not in self.messages:
            self._finish(fact.id)
        self._stop_waiting(self._reply_waits.pop(fact.id, None))
        number, is_copy = fact.copy_of or fact.id, fact.copy_of > 0
        self.drops.append(Drop(self.time, fact.message, fact.why, number, is_copy, fact.dropping))
        if message := self.messages.get(fact.id):
            is_deadlock = fact.dropping is Dropping.DEADLOCK
            cycle = self.deadlocks.get((self.time, message.sender), "") if is_deadlock else ""
            self._change(message, "dropped", cycle or fact.why)
            message.dropping = fact.dropping

    def _answer(self, fact: facts.Answered) -> None:
        self._stop_waiting(self._reply_waits.pop(fact.id, None))
        if message := self.messages.get(fact.id):
            message.answered = self.time

    def _await_answer(self, fact: facts.Awaited) -> None:
        """Start the wait for an answer now: the asker continued after it had asked."""
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
        wait = HandlerWait(fact.task, self.time, moment, kind=fact.awaits, name=fact.name)
        self._wait(wait, fact.module, fact.origin)
        self._task_waits.setdefault(fact.key, []).append(wait)

    def _wait_ended(self, fact: facts.WaitEnded) -> None:
        waits = self._task_waits.pop(fact.key, [])
        if waits:
            self._stop_waiting(waits.pop())
        if waits:  # another thread of the module waits for the same thing
            self._task_waits[fact.key] = waits

    def _claimed(self, fact: facts.Claimed) -> None:
        claim = self.claims[fact.id] = Claim(
            fact.id,
            fact.module,
            fact.resource,
            fact.is_reserved,
            fact.sender,
            fact.origin,
            self.time,
            by=self._deliveries.get(fact.origin),
        )
        self.requested.setdefault((called(fact.module), fact.resource), []).append(claim)
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
        """Add *wait* to the handler of delivery *origin*, or to the module outside of handlers."""
        handling = self._deliveries.get(origin)
        waiting = handling or self._module(module)
        waiting.waits = appended(waiting.waits, wait)
        wait.by = handling or module
        self.news.append(wait)
        self._touch(handling.message_id if handling else 0)
        return wait

    def _stop_waiting(self, wait: HandlerWait | None) -> None:
        if wait and wait.end is None:
            wait.end = self.time
            self.news.append(wait)
            self._touch(wait.by.message_id if isinstance(wait.by, Handling) else 0)


_METHODS = takers(History, RecordFold)


def _is_of_root(fact: facts.Fact) -> bool:
    """Whether a fact is about the root: central never writes such a fact."""
    if isinstance(fact, TaskFact):
        return fact.task <= ROOT
    return isinstance(fact, MonitorFact) and fact.monitor <= ROOT


def folded(
    journal: Log, time: float | None = None, entries: Iterable[facts.Entry] | None = None
) -> History:
    """Return the history of a journal.

    Args:
        journal: The journal.
        time: The time at which the run is viewed, in seconds on its clock. None is the end,
            or the present of a live run.
        entries: The journal's entries, if the caller iterates over them; None to read them here.

    Raises:
        UnusableLog: The journal has no entries.
    """
    history = History.until(journal if entries is None else entries, time)
    history.extend_to(journal.present(history.time), time)
    return history
