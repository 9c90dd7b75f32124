"""The state of central, and operations on several of its parts. The rules are in other files."""

from tca_central.errors import RequestError
from tca_central.events import LimitsSet, MembersChanged, Transmit
from tca_central.model.answers import KeptAnswers
from tca_central.model.budget import (
    ATTACHED_BYTES,
    CLAIM_BYTES,
    EDGE_BYTES,
    HANDLER_BYTES,
    TASK_BYTES,
    TIMER_BYTES,
    WAIT_BYTES,
    Budget,
)
from tca_central.model.clock import Timer
from tca_central.model.contexts import RaisedFailure
from tca_central.model.deliveries import (
    CONFIRMED_TOGETHER,
    AttachedHandler,
    Connection,
    Delivery,
    MessageType,
    ModuleClaim,
    Wiretap,
)
from tca_central.model.memory import Memory
from tca_central.model.observers import Observation, Observers, encode_change
from tca_central.model.registry import Registry, Variables
from tca_central.model.stored import Stored
from tca_central.model.task_tree import TaskTree, taps_of
from tca_central.model.tasks import Task, TaskOutcome, Watch
from tca_central.order.agenda import Agenda
from tca_central.order.dispatcher import Dispatcher
from tca_central.present import Waits
from tca_wire.journal import facts
from tca_wire.packets import headers
from tca_wire.packets.headers import Answer, ToModule
from tca_wire.packets.large import held_size
from tca_wire.packets.parts import MessageFormat, StateChange
from tca_wire.points import ROOT, TaskId
from tca_wire.rules import DELIVERED
from tca_wire.text import measures
from tca_wire.text.printable import shortened
from tca_wire.vocabulary import CENTRAL, Dropping, Due, MessageClass, Outcome, Party, Refusal


class Collector(Stored):
    """A multi-query in progress: the replies wanted, and the deliveries that may give them."""

    __slots__ = (
        "answered",
        "connection",
        "end",
        "failures",
        "id",
        "message",
        "module_of",
        "number",
        "origin",
        "pending",
        "wanted",
    )

    def __init__(
        self, connection: Connection, number: int, original: Delivery, wanted: int
    ) -> None:
        self.connection, self.number, self.wanted = connection, number, wanted
        self.id, self.message = original.id, original.message
        self.origin = original.origin  #: the delivery whose handler sent the query (0: none)
        self.pending: dict[int, Delivery] = {}  #: by id: copies that have not been answered
        self.module_of: dict[int, str] = {}  #: by delivery id: the module that got the copy
        self.answered = 0
        self.failures: list[str] = []  #: failures so far, each with its module
        #: The final answer, if it were sent now: None at first, then the first failure, and "done"
        #: as soon as a reply has come.
        self.end: tuple[Answer, bytes] | None = None

    @property
    def size(self) -> int:
        """The bytes that the final answer holds."""
        return 0 if self.end is None else held_size(self.end[1])


class TaskWait(Stored):
    """A connection's wait for a moment of a task."""

    __slots__ = ("connection", "lends_slot", "moment", "number", "origin", "task_id")

    def __init__(self, connection: Connection, header: headers.AwaitPoint) -> None:
        self.connection, self.number, self.origin = connection, header.number, header.origin
        self.task_id, self.moment = header.point.task, int(header.point.moment)
        self.lends_slot = header.lends_slot

    def answer(self, central: "State", outcome: TaskOutcome) -> None:
        """Answer the waiter with the task's outcome."""
        if self.connection.outstanding.pop(self.number, None) is not None:
            central.facts.append(
                facts.WaitEnded(self.connection.module.name, self.origin, self.task_id)
            )
            result, failure, text, body = outcome
            central.answer(
                self.connection, self.number, Answer(self.number, result, failure, text), body
            )


class RestartPause(Stored):
    """The reasons why no task starts after a restart of central."""

    __slots__ = ("awaited", "grace", "until_resumed")

    def __init__(self) -> None:
        self.awaited: dict[Connection, None] = {}  #: connections that may come back
        self.grace: Timer | None = None  #: the timer after which ``awaited`` are lost
        self.until_resumed = False  #: whether an operator must let tasks start


def cancelled_header(delivery: Delivery) -> headers.Cancelled:
    """Return the header that asks a handler to stop: its task was killed or is retried."""
    killed = delivery.killed if isinstance(delivery, Task) else ""
    return headers.Cancelled(delivery.handling_id, killed or "it is to be handled again")


def dropped_fact(
    delivery: Delivery, why: str, where: str = "", dropping: Dropping = Dropping.OTHER
) -> facts.Dropped:
    """Return the fact that a message, or a copy of it for one receiver, is dropped."""
    return facts.Dropped(delivery.id, delivery.message.name, why, delivery.copy_of, where, dropping)


def drop(
    central: "State", delivery: Delivery, why: str, dropping: Dropping = Dropping.OTHER
) -> None:
    """Drop a message, or a copy of it, that a handler should have received."""
    delivery.message.dropped += 1
    central.facts.append(dropped_fact(delivery, why, dropping=dropping))


def deliver_header(delivery: Delivery, ahead: int = 0) -> headers.Deliver:
    """Return the header that brings a delivery to its handler.

    *ahead* is the number of messages that the slot handles before this one (0: the slot is free).
    """
    handling_id, name = delivery.handling_id, delivery.message.name
    context = delivery.context.header if delivery.context is not None else None
    if isinstance(delivery, Task):
        return headers.Deliver(handling_id, name, delivery.id, context, delivery.suspended)
    return headers.Deliver(handling_id, name, ROOT, context, ahead=ahead)


def _over_budget(what: str, held: int, most: int, advice: str) -> str:
    """Return the text of a refusal because a part of the budget is used up."""
    return (
        f"{what} hold {measures.size(held)} of the {measures.size(most)} that they may: {advice}, "
        "or start central with more --memory"
    )


class State(Waits):
    """All parts of the state, and the operations that concern several of them."""

    __slots__ = (
        "agenda",
        "answers",
        "attached",
        "budget",
        "claimed_for",
        "claims",
        "collectors",
        "dispatcher",
        "is_disk_low",
        "lost_ids",
        "members",
        "memory",
        "observers",
        "registry",
        "restart_pause",
        "taps",
        "tree",
        "unconfirmed",
        "variables",
        "watch_of_condition",
        "watches",
    )

    def __init__(self, epoch: str = "test") -> None:
        Waits.__init__(self, epoch)
        self.budget, self.answers = Budget(), KeptAnswers(Budget().answers)
        self.registry, self.observers = Registry(), Observers()
        self.variables, self.memory = Variables(), Memory()
        self.tree = TaskTree(
            MessageType(MessageFormat("root", MessageClass.GOAL, "", ""), "central")
        )
        self.agenda = Agenda(self.tree, self.facts, self.clock)
        self.dispatcher = Dispatcher(self.facts, self, self.suspects, self.clock)
        self.attached: dict[int, AttachedHandler] = {}  #: all exception handlers, by id
        self.taps: dict[int, Wiretap] = {}  #: all wiretaps, by id
        self.watches: dict[int, Watch] = {}  #: by task id: monitors that watch now or later
        #: By id of the delivery of a monitor's condition: the monitor.
        self.watch_of_condition: dict[int, Watch] = {}
        #: By claimant and request number: all claims.
        self.claims: dict[tuple[Connection, int], ModuleClaim] = {}
        #: By delivery: the claims that end when the delivery ends.
        self.claimed_for: dict[Delivery, list[ModuleClaim]] = {}
        #: By id of a multi-query's copy for one receiver: the multi-query.
        self.collectors: dict[int, Collector] = {}
        #: Connections that still have to get the ids of their tasks (``Send.quiet``).
        self.unconfirmed: dict[Connection, None] = {}
        self.restart_pause = RestartPause()
        #: Ranges (first, last) of ids that central may have given, and the disk has lost.
        self.lost_ids: list[tuple[int, int]] = []
        self.is_disk_low = False  #: whether new tasks are refused
        #: The centrals with the same replicated log; None without such a log.
        self.members: MembersChanged | None = None

    def deliver(self, delivery: Delivery, slot: Connection, *, is_prefetched: bool) -> None:
        """Give a message to the handler in a slot. Every delivery goes through here.

        A message that *is_prefetched* is in the slot already; others are sent now.
        """
        slot.handling[delivery], delivery.has_begun = self.event_count, False
        resource = slot.resource
        assert resource is not None
        # A prefetched message began when its slot became free. Central may learn of that later.
        now = self.clock.now
        began = (
            max(delivery.since, slot.next_began_at) if is_prefetched and slot.next_began_at else now
        )
        slot.maybe_unstarted = delivery if is_prefetched and not slot.next_began_at else None
        delivery.since, slot.next_began_at = began, 0.0
        delivery.message.delivered += 1
        resource.delivered += 1
        fact = facts.Delivered(
            delivery.handling_id,
            delivery.message_id,
            resource.module,
            resource.name,
            resource.numbers[slot],
            delivery.nested,
            delivery.priority,
            began if began < now else 0.0,
        )
        self.facts.append(fact)
        if self.taps and taps_of(delivery):
            self.agenda.tap_events.append((delivery, DELIVERED))
        if isinstance(delivery, Task):
            self.agenda.mark_started(delivery)
            if delivery.message.custom_handlers or self.observers.may_observe(delivery):
                self.accept_for_handler(delivery)
            else:
                delivery.state = delivery.message.running_state
                delivery.serial += 1
        if not is_prefetched:
            self.messages.append(Transmit(slot.id, deliver_header(delivery), delivery.body))

    def accept_for_handler(self, task: Task) -> None:
        """Mark a task as accepted by its handler, unless the handler accepts tasks explicitly."""
        handler = task.handler
        if (handler is None or not handler.accepts) and task.state == task.message.initial_state:
            task.state = task.message.running_state
            task.serial += 1
            module = task.slot.module.name if task.slot is not None else ""
            self.notify_observers(task, task.message.life_cycle.accepted.name, Party.SERVER, module)

    # --- observers --------------------------------------------------------------------------------

    def report_new_task(self, task: Task) -> None:
        """Report a new task to its observers."""
        if self.observers.may_observe(task) and task.state == task.message.initial_state:
            module = task.sender.module.name if task.sender is not None else ""
            self.notify_observers(
                task, "initiated", Party.CLIENT if module else Party.CENTRAL, module
            )

    def notify_observers(
        self,
        task: Task,
        transition: str,
        by: Party,
        module: str = "",
        text: str = "",
        data: bytes = b"",
        *,
        outcome: Outcome | None = None,
        request: int = 0,
    ) -> None:
        """Report a change of a task's state to its observers.

        With an *outcome* the task has ended, and so do observations of it or its subtree. *request*
        is the number of the client's request that the change makes or answers.
        """
        observers = list(self.observers.of(task)) if self.observers.may_observe(task) else []
        if not (observers or (outcome is not None and self.observers.of_many)):
            return
        change = StateChange(
            TaskId(int(task.id)),
            task.message.name,
            task.serial,
            task.state,
            transition,
            by,
            module,
            text,
            task.body,
            data,
            is_over=outcome is not None,
            outcome=outcome,
            request=request,
        )
        encoded = encode_change(change)
        for one in observers:
            self.notify_observer(one, encoded, task.state)
        if outcome is not None:
            found = (*observers, *self.observers.of_many)
            for one in [one for one in found if task.id in (one.task_id, one.below)]:
                self.end_observers_wait(one)
                self.observers.remove(one)
                one.connection.outstanding.pop(one.number, None)
                self.answer(one.connection, one.number, Answer(one.number))

    def notify_observer(self, observation: Observation, encoded: bytes, state: str) -> None:
        """Report a change to an observer, if the observer wants to know of the new *state*."""
        if not observation.states or state in observation.states:
            self.end_observers_wait(observation)
            observation.notifications += 1
            self.notify(observation.connection, Answer(observation.number, more=True), encoded)

    def end_observers_wait(self, observation: Observation) -> None:
        """End an observer's wait for a change: a change came, or the observer waits no longer."""
        if not observation.is_awaited:
            return
        connection, number = observation.connection, observation.number
        wait = connection.unchecked_waits.get(number) or connection.waits.get(number)
        self.unblock(connection, number)
        # A blocked thread may have waited for several observations. One change ends all its waits.
        # A coroutine's wait ends alone: other coroutines may still wait for those observations.
        others = wait.together if wait is not None and not wait.is_coroutine else ()
        for awaited in (observation, *map(connection.outstanding.get, others)):
            if isinstance(awaited, Observation) and awaited.is_awaited:
                awaited.is_awaited = False
                self.facts.append(facts.WaitEnded(*awaited.wait))

    # --- messages to modules ----------------------------------------------------------------------

    def send_prefetched(self, delivery: Delivery, slot: Connection) -> None:
        """Send a slot a prefetched message. The slot handles its earlier messages first."""
        assert slot.resource is not None
        ahead = len(slot.handling) + len(slot.resource.prefetched) - 1
        self.messages.append(Transmit(slot.id, deliver_header(delivery, ahead), delivery.body))

    def recall(self, slot: Connection) -> None:
        """Ask a slot to return prefetched messages that it has not begun."""
        assert slot.resource is not None
        self.facts.append(facts.Recalling(slot.resource.module, slot.resource.name))
        self.notify(
            slot, headers.Recall([delivery.handling_id for delivery in slot.resource.prefetched])
        )

    def outcome(self, task: Task) -> TaskOutcome:
        """Return a task's outcome, the name and text of its failure, and its result.

        For a killed task, the text is the reason. For a failed task, the failure's data replaces
        the result.
        """
        if task.failure is not None:
            failure, text, body = task.failure
            if not task.is_dealt_with:
                return Outcome.FAILED, failure, text, body
            if not task.killed:
                return Outcome.RESOLVED, failure, text, task.result
        if task.killed:
            return Outcome.KILLED, "", task.killed, b""
        return Outcome.DONE, "", "", task.result

    def record_failure(
        self,
        delivery: Delivery,
        failure: RaisedFailure,
        *,
        from_outside: bool = False,
        by: str = "",
    ) -> None:
        """Record a failure of a task or message.

        *from_outside* means that module *by* raised the failure, not the task's own handler.
        """
        body = failure.body if from_outside else b""
        name, text, copy_of = failure.name, failure.text, delivery.copy_of
        self.facts.append(facts.Failed(delivery.id, name, text, from_outside, by, body, copy_of))
        self.failed[delivery.id] = str(delivery)

    def answer(
        self, connection: Connection, number: int, header: ToModule, body: bytes = b""
    ) -> None:
        """Answer a request for good, and store the answer in case the request is repeated."""
        if connection.waits or connection.unchecked_waits:
            self.unblock(connection, number)
        if connection.unconfirmed:
            self.confirm_tasks(connection)
        if number:
            self.answers.add(connection, number, header, body)
        self.messages.append(Transmit(connection.id, header, body))

    def refuse(self, connection: Connection, number: int, refusal: Refusal, text: str) -> None:
        """Refuse a request."""
        text = shortened(text)
        self.facts.append(facts.RequestRefused(connection.module.name, refusal, text))
        if number:
            connection.outstanding.pop(number, None)
            self.answer(connection, number, headers.Refused(number, refusal, text))
        else:
            self.notify(connection, headers.Refused(0, refusal, text))

    def set_limits(self, limits: LimitsSet) -> None:
        """Apply new limits. Stored answers beyond a limit are forgotten; all else stays."""
        self.budget.split(limits.memory)
        self.budget.tap_depth, self.budget.task_depth = limits.tap_depth, limits.task_depth
        self.budget.keeps_inputs = limits.keeps_inputs
        self.answers.most = self.budget.answers
        self.answers.evict()

    # --- the budget -------------------------------------------------------------------------------

    @property
    def message_bytes(self) -> int:
        """The bytes that messages, tasks and constraints hold."""
        return (
            self.dispatcher.bytes
            + self.tree.bytes
            + self.agenda.holds.edge_count * EDGE_BYTES
            + self.budget.collector_bytes
        )

    @property
    def declared_bytes(self) -> int:
        """The bytes of all else that modules declare, attach, claim and wait for."""
        return (
            self.registry.bytes
            + self.dispatcher.handler_count * HANDLER_BYTES
            + (len(self.attached) + len(self.taps)) * ATTACHED_BYTES
            + len(self.claims) * CLAIM_BYTES
            + self.clock.timer_count * TIMER_BYTES
            + self.agenda.wait_count * WAIT_BYTES
            + self.budget.presence_bytes
        )

    def refuse_if_full(self, size: int) -> str:
        """Return "" if there is room for a message of *size* bytes.

        Otherwise count a refusal and return its text.
        """
        held, most = self.message_bytes, self.budget.messages
        if held + TASK_BYTES + size <= most:
            return ""
        self.budget.refused += 1
        what = f"no room for {size:,} bytes: messages and tasks"
        return _over_budget(what, held, most, "let handlers catch up, or end tasks")

    def check_room(self, size: int) -> None:
        """Raise RequestError if there is no room for a message of *size* bytes."""
        if why := self.refuse_if_full(size):
            raise RequestError(Refusal.OVERLOAD, why)

    def refuse_own_task_if_full(self, what: str, body: bytes) -> bool:
        """Refuse a task that central would send, if memory is full. Return whether it was refused.

        The recorded refusal names *what* would have been sent.
        """
        if why := self.refuse_if_full(held_size(body)):
            self.facts.append(
                facts.RequestRefused(CENTRAL, Refusal.OVERLOAD, f"{what} is not sent: {why}")
            )
        return bool(why)

    # --- limits of depth, which end endless chains ------------------------------------------------

    @property
    def tap_depth(self) -> int:
        """The number of wiretaps' listeners among the causes of the present request."""
        asking = self.dispatcher.running.get(self.origin) if self.origin else None
        return asking.tap_depth if asking is not None else 0

    def check_tap_depth(self, message: MessageType) -> None:
        """Raise RequestError if a message would call one listener too many in its chain."""
        if not message.taps or self.tap_depth < self.budget.tap_depth:
            return
        tap = next((tap for tap in message.taps if tap.is_heard), None)
        if tap is not None:
            message.dropped += 1
            raise RequestError(Refusal.OVERLOAD, self.why_too_deep(tap, f"'{message.name}'"))

    def why_too_deep(self, tap: Wiretap, tapped: object) -> str:
        """Return why *tap* does not send its listener for *tapped*: the chain would be too long."""
        most = self.budget.tap_depth
        text = f"{tapped} would call '{tap.listener.name}' (wiretap {{{tap.id}}}, {tap.condition})"
        text = f"{text} after {most} other listeners in its chain of causes"
        return (
            f"{text}, and at most {most} are allowed: let no listener send what it taps, "
            "or set --tap-depth of central"
        )

    def check_task_depth(self, message: MessageType, parent: Task) -> None:
        """Raise RequestError if a task would stand too deep in the tree."""
        if parent.depth >= self.budget.task_depth:
            message.dropped += 1
            depth, most = parent.depth + 1, self.budget.task_depth
            raise RequestError(
                Refusal.OVERLOAD,
                f"{message.title} would stand {depth:,} tasks deep in the tree, and at most "
                f"{most:,} are allowed: "
                "send it under an older task, or set --task-depth of central",
            )

    def check_declared(self, size: int) -> None:
        """Raise RequestError if there is no room for *size* more ``declared_bytes``."""
        held, most = self.declared_bytes, self.budget.declared
        if held + size > most:
            self.budget.refused += 1
            what = "declarations, attachments, claims, waits and timers"
            raise RequestError(
                Refusal.OVERLOAD,
                _over_budget(what, held, most, "end those that are no longer needed"),
            )

    def accept(self, connection: Connection, number: int, subject: int = 0) -> None:
        """Answer that a request was done. *subject* is the id of what it created or concerns."""
        self.answer(connection, number, headers.Accepted(number, TaskId(subject)))

    def accept_task(
        self, connection: Connection, number: int, task: TaskId, *, quiet: bool
    ) -> None:
        """Answer that a request has sent a task.

        A *quiet* request is confirmed later, together with others: that saves a packet per task.
        """
        connection.remember_task(number, task)
        if not quiet:
            self.accept(connection, number, task)
            return
        connection.unconfirmed.append((number, task))
        self.unconfirmed[connection] = None
        if len(connection.unconfirmed) >= CONFIRMED_TOGETHER:
            self.confirm_tasks(connection)

    def confirm_tasks(self, connection: Connection) -> None:
        """Send a connection the ids of its unconfirmed tasks."""
        confirmed, connection.unconfirmed = connection.unconfirmed, []
        del self.unconfirmed[connection]
        self.notify(connection, headers.TasksMade(confirmed))

    def living_task_or_ignore(
        self, connection: Connection, number: int, task_id: TaskId, consequence: str
    ) -> Task | None:
        """Return the task of that id.

        If the task has ended or was killed, ignore the request and return None. *consequence* is
        the end of the warning, such as "no deadline can be set".
        """
        task = self.tree.task(task_id)
        if task is not None and not task.killed:
            return task
        ended = f"task {{{task_id}}} has ended" if task is None else f"{task} was killed"
        self.ignore(connection, number, f"{ended}: {consequence}")
        return None

    def ignore(self, connection: Connection, number: int, text: str) -> None:
        """Accept a request that came too late, and do nothing but record that (TCM: a warning)."""
        self.facts.append(facts.Ignored(connection.module.name, text))
        self.accept(connection, number)

    def cancel(self, slot: Connection, delivery: Delivery) -> None:
        """Ask a running handler to clean up and return. The wait of its coroutine ends."""
        self.unblock_coroutine(slot, delivery.handling_id)
        self.expect_return(slot, delivery)
        self.notify(slot, cancelled_header(delivery))

    def expect_return(self, slot: Connection, delivery: Delivery) -> None:
        """Start the timer after which a handler that should return counts as hung."""
        if slot.hung_after and delivery.handling_id not in slot.hang_timers:
            slot.hang_timers[delivery.handling_id] = self.clock.after(
                slot.hung_after, Due.HUNG, delivery
            )

    def new_id(self) -> int:
        """Return the next id. Ids are never reused."""
        self.tree.newest += 1
        return self.tree.newest
