"""Folds the facts of a journal into what was known at a moment: tasks, messages, modules and their doings.

Pure, and O(1) for each fact. It re-runs no rule of central, and takes any facts: a journal may begin in the middle.
"""

from collections.abc import Callable, Iterable
from typing import Any

from tca_tools.records import Claim, Handling, Message, ModuleRecord, Queueing, Task, Wait
from tca_wire import facts
from tca_wire.points import MOMENTS, ROOT, Moment, Point, TaskId
from tca_wire.vocabulary import MessageClass, Outcome, Role

UNKNOWN = "?"
"""The name of what was sent before the journal's first entry."""


class History:
    """What happened until ``time``; ``apply`` is the only way it changes.

    1. ``tasks`` holds every task, ``messages`` every message, tasks included.
    2. A task's parent is the root or a task with a smaller id, so walks up and down end.
    """

    def __init__(self) -> None:
        self.time = 0.0
        self.began: float | None = None
        """Wall-clock time (seconds since 1970) at which ``time`` was 0."""
        self.epoch = ""
        self.top: list[TaskId] = []
        """The tasks under the root."""
        self.tasks: dict[int, Task] = {}
        self.messages: dict[int, Message] = {}
        self.handlings: list[Handling] = []
        self.queueings: list[Queueing] = []
        self.modules: dict[str, ModuleRecord] = {}
        self.claims: dict[int, Claim] = {}
        """Locks and reservations."""
        self.held_by: dict[tuple[str, str], Claim] = {}
        """By module and resource, the lock or reservation in force."""
        self.handlers: dict[str, dict[str, str]] = {}
        """For each message its handlers: module and resource."""
        self.formats: dict[str, facts.FormatDefined] = {}
        """For each message its class and formats, as first declared."""
        self.lost_directly: dict[str, int] = {}
        """How many informs of each message were sent directly and lost."""
        self._deliveries: dict[int, Handling] = {}
        self._queued: dict[int, Queueing] = {}
        self._running: dict[tuple[str, str], dict[int, Handling]] = {}
        self._reply_waits: dict[int, Wait] = {}
        self._claim_waits: dict[int, Wait] = {}
        self._task_waits: dict[tuple[str, int, int], list[Wait]] = {}

    @classmethod
    def until(cls, entries: Iterable[facts.Entry], time: float | None = None) -> "History":
        """What was known at *time* (None: at the end)."""
        history = cls()
        for entry in entries:
            if time is not None and entry.time > time:
                history.time = time
                break
            history.apply(entry)
        return history

    def apply(self, entry: facts.Entry) -> None:
        """Take in the facts that one event caused."""
        self.time = max(self.time, entry.time)
        for fact in entry.facts:
            if take := _TAKE.get(type(fact)):
                take(self, fact)

    def children(self, task: int) -> list[TaskId]:
        """The tasks right under *task*, oldest first."""
        return self.top if task == ROOT else self.tasks[task].children

    def has_reached(self, point: Point) -> bool:
        """Whether the point is past; what is unknown ended before the journal began."""
        task = self.tasks.get(point.task)
        return task is None or point.moment in task.reached

    def running(self, module: str, resource: str) -> list[Handling]:
        """The handlers that run in a resource now."""
        return list(self._running.get((module, resource), {}).values())

    def describe(self, message_id: int) -> str:
        """A message's name with its id: ``take steps {7}``."""
        claim = self.claims.get(message_id)
        return str(claim) if claim else f"{self.name(message_id)} {{{message_id}}}"

    def name(self, message_id: int) -> str:
        """A message's name."""
        message = self.messages.get(message_id)
        return message.name if message else UNKNOWN

    # --- what each fact changes -----------------------------------------------------------------------------------

    def _opened(self, fact: facts.Opened) -> None:
        if self.began is None:
            self.began = fact.began
        self.epoch = fact.epoch

    def _closed(self, _fact: facts.Closed) -> None:
        for module in self.modules:
            self._leave(module, "central ended")

    def _joined(self, fact: facts.ModuleJoined) -> None:
        module = self._module(fact.module)
        if not module.joined or module.joined[-1][1] is not None:
            module.joined.append((self.time, None))

    def _left(self, fact: facts.ModuleLeft) -> None:
        self._leave(fact.module, fact.why)

    def _leave(self, name: str, why: str) -> None:
        module = self._module(name)
        if module.joined and module.joined[-1][1] is None:
            module.joined[-1] = (module.joined[-1][0], self.time)
            module.left = why
        for resource in ("", *module.resources):
            for handling in self._running.pop((name, resource), {}).values():
                self._end(handling)

    def _resource(self, fact: facts.ResourceChanged) -> None:
        self._module(fact.module).resources[fact.resource] = fact.capacity

    def _format(self, fact: facts.FormatDefined) -> None:
        self.formats.setdefault(fact.message, fact)

    def _handler(self, fact: facts.HandlerAdded) -> None:
        self.handlers.setdefault(fact.message, {})[fact.module] = fact.resource

    def _no_handler(self, fact: facts.HandlerRemoved) -> None:
        self.handlers.get(fact.message, {}).pop(fact.module, None)

    def _received(self, fact: facts.Received) -> None:
        if fact.id <= 0 or fact.id in self.messages:
            return
        known = (fact.id, fact.message, fact.message_class, fact.sender, fact.origin, self.time, fact.body)
        if fact.message_class.is_task:
            self._plant(Task(*known, role=fact.role, about=fact.about, parent=fact.parent))
            self._constrain(fact)
        else:
            self.messages[fact.id] = Message(*known, role=fact.role, about=fact.about)
        if fact.blocking and not fact.message_class.is_task:
            self._reply_waits[fact.id] = self._wait(Wait(fact.id, self.time), fact.sender, fact.origin)

    def _plant(self, task: Task) -> None:
        """Put a new task into the tree."""
        self.messages[task.id] = self.tasks[task.id] = task
        if task.parent != ROOT and 0 < task.parent < task.id:
            parent = self._task(task.parent)
            parent.children.append(TaskId(task.id))
            task.is_suspended = parent.is_suspended and not _outlives(task)
        else:
            task.parent = ROOT
            self.top.append(TaskId(task.id))

    def _constrain(self, fact: facts.Received | facts.Constrained) -> None:
        for constraint in fact.constraints:
            if constraint.after.task in self.tasks:
                self.tasks[constraint.after.task].constraints.append(constraint)

    def _queue(self, fact: facts.Queued) -> None:
        self._finish(fact.id)  # its handler left, and it waits for the next
        self._unqueue(fact.id)
        queueing = Queueing(fact.message_id, fact.module, fact.resource, self.time)
        self._queued[fact.id] = queueing
        self.queueings.append(queueing)
        if message := self.tasks.get(fact.message_id) or self.messages.get(fact.id):
            message.queueing = queueing

    def _leave_queue(self, fact: facts.Unqueued) -> None:
        self._finish(fact.id)  # its handler left, and it may not wait for the next yet
        self._unqueue(fact.id)

    def _unqueue(self, delivery: int) -> Queueing | None:
        if queueing := self._queued.pop(delivery, None):
            queueing.end = self.time
        return queueing

    def _deliver(self, fact: facts.Delivered) -> None:
        self._finish(fact.id)
        self._unqueue(fact.id)
        message = self.messages.get(fact.message_id)
        handling = Handling(fact.message_id, self.name(fact.message_id), fact.module, fact.resource, self.time)
        self.handlings.append(handling)
        self._deliveries[fact.id] = handling
        self._running.setdefault((fact.module, fact.resource), {})[fact.id] = handling
        self._module(fact.module).resources.setdefault(fact.resource, 1)
        if message:
            message.handlings.append(handling)
            message.failure = ""

    def _return(self, fact: facts.Returned) -> None:
        if handling := self._finish(fact.id):
            handling.outcome = fact.outcome
            if message := self.messages.get(handling.message_id):
                message.result = fact.body

    def _direct(self, fact: facts.HandledDirectly) -> None:
        start = max(0.0, fact.ended - fact.seconds)
        handling = Handling(0, fact.message, fact.module, fact.resource, start, fact.ended, fact.outcome)
        handling.direct_from = fact.sender
        self.handlings.append(handling)
        self._module(fact.module).resources.setdefault(fact.resource, 1)

    def _direct_lost(self, fact: facts.LostDirectly) -> None:
        self.lost_directly[fact.message] = self.lost_directly.get(fact.message, 0) + fact.number

    def _finish(self, delivery: int) -> Handling | None:
        """The handler of a delivery no longer has it."""
        if handling := self._deliveries.pop(delivery, None):
            self._running.get((handling.module, handling.resource), {}).pop(delivery, None)
            self._end(handling)
        return handling

    def _end(self, handling: Handling) -> None:
        if handling.end is None:
            handling.end = self.time
        for wait in handling.waits[-1:]:
            wait.end = self.time if wait.end is None else wait.end

    def _reach(self, fact: facts.Reached) -> None:
        if fact.task <= 0:
            return
        task = self._task(fact.task)
        for moment in MOMENTS:
            if fact.moments & moment:
                task.reached.setdefault(moment, self.time)

    def _fail(self, fact: facts.Failed) -> None:
        if not fact.is_beside:
            self._unqueue(fact.id)
        lost = None if fact.is_beside else self._finish(fact.id)  # of a module that was lost no handler returns
        if lost:
            lost.outcome = Outcome.FAILED
        if message := self.messages.get(lost.message_id if lost else fact.id):
            message.failure = f"{fact.failure}: {fact.text}" if fact.text else fact.failure

    def _kill(self, fact: facts.Killed) -> None:
        if fact.task > 0:
            self._task(fact.task).killed = fact.why
            self._unqueue(fact.task)

    def _drop(self, fact: facts.Dropped) -> None:
        self._unqueue(fact.id)
        if fact.id not in self.messages:  # a copy, for a listener that left; who gave up a message may still handle it
            self._finish(fact.id)
        self._stop_waiting(self._reply_waits.pop(fact.id, None))
        if message := self.messages.get(fact.id):
            message.dropped = fact.why

    def _answer(self, fact: facts.Answered) -> None:
        self._stop_waiting(self._reply_waits.pop(fact.id, None))

    def _caught(self, fact: facts.Caught) -> None:
        if fact.task > 0:
            task = self._task(fact.task)
            task.caught_by.append(fact.handler)
            task.is_recovering, task.is_dealt_with = True, False

    def _unhandled(self, fact: facts.Unhandled) -> None:
        if fact.task > 0:
            self._task(fact.task).is_recovering = False

    def _recovered(self, fact: facts.Recovered) -> None:
        if fact.task > 0:
            task = self._task(fact.task)
            task.is_recovering, task.is_dealt_with = False, True

    def _retried(self, fact: facts.Retried) -> None:
        if fact.task > 0:
            task = self._task(fact.task)
            task.is_recovering, task.failure = False, ""
            task.body = fact.body or task.body

    def _suspended(self, fact: facts.SuspendedOrResumed) -> None:
        below = [fact.task] if fact.task > 0 else []
        for task_id in below:  # grows while it is walked
            task = self._task(task_id)
            task.is_suspended = fact.is_suspended
            below += [child for child in task.children if Moment.END_ACHIEVING not in self.tasks[child].reached]

    def _timed_out(self, fact: facts.TimedOut) -> None:
        if (held := fact.constraint.after.task) > 0:
            self._task(held).timed_out.append(fact.constraint)

    def _wait_began(self, fact: facts.WaitBegan) -> None:
        moment = next((moment for moment in MOMENTS if fact.moment & moment), None)
        wait = self._wait(Wait(fact.task, self.time, moment), fact.module, fact.origin)
        self._task_waits.setdefault((fact.module, fact.origin, fact.task), []).append(wait)

    def _wait_ended(self, fact: facts.WaitEnded) -> None:
        key = (fact.module, fact.origin, fact.task)
        waits = self._task_waits.pop(key, [])
        if waits:
            self._stop_waiting(waits.pop())
        if waits:  # another thread of the module waits for the same
            self._task_waits[key] = waits

    def _claimed(self, fact: facts.Claimed) -> None:
        claim = Claim(
            fact.id, fact.module, fact.resource, fact.is_reserved, fact.sender, fact.origin, self.time
        )  # fmt: skip
        self.claims[fact.id] = claim
        self._claim_waits[fact.id] = self._wait(Wait(fact.id, self.time), fact.sender, fact.origin)

    def _granted(self, fact: facts.Granted) -> None:
        self._stop_waiting(self._claim_waits.pop(fact.id, None))
        if (claim := self.claims.get(fact.id)) is not None:
            claim.granted = self.time
            self.held_by[claim.module, claim.resource] = claim

    def _claim_ended(self, fact: facts.ClaimEnded) -> None:
        self._stop_waiting(self._claim_waits.pop(fact.id, None))
        if (claim := self.claims.get(fact.id)) is not None:
            claim.end, claim.ended = self.time, fact.why
            if self.held_by.get((claim.module, claim.resource)) is claim:
                del self.held_by[claim.module, claim.resource]

    def _wait(self, wait: Wait, module: str, origin: int) -> Wait:
        """Note *wait* at the handler of delivery *origin*, or at the module where it runs outside of any."""
        handling = self._deliveries.get(origin)
        (handling.waits if handling else self._module(module).waits).append(wait)
        return wait

    def _stop_waiting(self, wait: Wait | None) -> None:
        if wait and wait.end is None:
            wait.end = self.time

    # --- records made when they are first needed --------------------------------------------------------------------

    def _module(self, name: str) -> ModuleRecord:
        if name not in self.modules:
            self.modules[name] = ModuleRecord(name)
        return self.modules[name]

    def _task(self, task: TaskId) -> Task:
        """A task; one sent before the journal begins gets a record under the root."""
        if task not in self.tasks:
            self._plant(Task(task, UNKNOWN, MessageClass.GOAL, "", 0, self.time))
        return self.tasks[task]


def _outlives(task: Task) -> bool:
    """Whether it is not suspended with what is above it: it leaves things safe."""
    return task.role in (Role.TERMINATION, Role.CANCEL)


# ruff: noqa: SLF001
_TAKE: dict[type, Callable[[History, Any], None]] = {
    facts.Opened: History._opened,
    facts.Closed: History._closed,
    facts.ModuleJoined: History._joined,
    facts.ModuleLeft: History._left,
    facts.ResourceChanged: History._resource,
    facts.FormatDefined: History._format,
    facts.HandlerAdded: History._handler,
    facts.HandlerRemoved: History._no_handler,
    facts.Received: History._received,
    facts.Constrained: History._constrain,
    facts.Queued: History._queue,
    facts.Unqueued: History._leave_queue,
    facts.Delivered: History._deliver,
    facts.Returned: History._return,
    facts.HandledDirectly: History._direct,
    facts.LostDirectly: History._direct_lost,
    facts.Reached: History._reach,
    facts.Failed: History._fail,
    facts.Killed: History._kill,
    facts.Dropped: History._drop,
    facts.Answered: History._answer,
    facts.Caught: History._caught,
    facts.Unhandled: History._unhandled,
    facts.Recovered: History._recovered,
    facts.Retried: History._retried,
    facts.SuspendedOrResumed: History._suspended,
    facts.TimedOut: History._timed_out,
    facts.WaitBegan: History._wait_began,
    facts.WaitEnded: History._wait_ended,
    facts.Claimed: History._claimed,
    facts.Granted: History._granted,
    facts.ClaimEnded: History._claim_ended,
}
