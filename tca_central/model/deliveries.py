"""Messages on their way, modules, connections, handlers and attachments. No rules, no clock."""

from collections import deque
from collections.abc import Iterable, Sequence
from typing import NamedTuple, Protocol

from tca_central.events import ConnectionId
from tca_central.model.budget import AWAITED_BYTES, WAIT_BYTES
from tca_central.model.clock import Timer
from tca_central.model.resources import Claim, PendingLimit, Resource
from tca_central.model.rights import Rights
from tca_central.model.stored import Stored
from tca_central.model.values import NOTHING_REFUSED, Blocking
from tca_wire.life_cycles import LifeCycle, read_life_cycle
from tca_wire.messages.notices import NOTICES
from tca_wire.packets.headers import WaitUntilHandled
from tca_wire.packets.parts import (
    HandlerFormat,
    MessageFormat,
    Tapped,
    Trouble,
    Watching,
    WatchOptions,
)
from tca_wire.points import TaskId
from tca_wire.vocabulary import Busy, Condition, Role

REMEMBERED_TASKS = 128
"""The number of newest tasks that a connection may name by request number instead of id."""

CONFIRMED_TOGETHER = 32
"""The number of unconfirmed tasks at which central sends their ids to the connection at once."""


class ModuleResource(Resource["Connection", "Delivery"]):
    """A resource of a module. Its slots are connections, and deliveries wait for the slots."""

    __slots__ = ("busy", "delivered", "limits", "quick_runs", "replaced")

    def __init__(self, module: str, name: str) -> None:
        super().__init__(module, name)
        #: By message name: the pending limits of its handlers.
        self.limits: dict[str, PendingLimit[Delivery]] = {}
        self.delivered = 0  #: number of messages that it was given
        self.busy = 0.0  #: seconds of handling, added up over its slots
        self.replaced = 0  #: number of slots lost because their handlers hung
        self.quick_runs = 0  #: number of quick runs of handlers in a row (order/prefetching.py)


class LostClaim(NamedTuple):
    """A lock or reservation that was revoked."""

    delivery: int  #: the delivery whose handler had the claim (0: none)
    resource: str
    text: str  #: why, and by which module


class ConnectionIdentity(Stored):
    """The identity of a connection, and the deliveries that it had when it broke."""

    __slots__ = (
        "id",
        "late_answers",
        "module",
        "number",
        "orphans",
        "principal",
        "pulse",
        "repeats_until",
        "rights",
        "session",
    )

    def __init__(
        self, connection_id: ConnectionId, session: str, module: "Module", number: int
    ) -> None:
        self.id = connection_id
        self.principal = module.principal  #: its owner
        self.rights: Rights | None = None  #: None: the connection may do everything
        self.session = session  #: its name across reconnects
        self.number = number  #: its number within its module
        self.module = module
        self.pulse = b""  #: the id of the heartbeats of its process (shell/pulses.py)
        #: The last delivery before it broke. Answers of deliveries up to this one may come twice.
        self.repeats_until = 0
        self.orphans: list[int] = []  #: deliveries that it had when it was lost, to be cancelled
        #: By orphan whose handler may still answer: the text with which the answer is refused.
        self.late_answers: dict[int, str] = {}


class Asker(ConnectionIdentity):
    """The requests of a connection, their answers, and its waits."""

    __slots__ = (
        "answer_bytes",
        "answers",
        "last_number",
        "lost_claims",
        "outstanding",
        "tasks",
        "unchecked_waits",
        "unconfirmed",
        "waits",
    )

    def __init__(
        self, connection_id: ConnectionId, session: str, module: "Module", number: int
    ) -> None:
        ConnectionIdentity.__init__(self, connection_id, session, module, number)
        self.last_number = 0  #: the highest number of a request so far
        #: By request: the delivery or wait that answers it.
        self.outstanding: dict[int, Stored] = {}
        #: Requests whose answers are stored, oldest first (model/answers.py)
        self.answers: deque[int] = deque()
        self.answer_bytes = 0  #: bytes of the stored answers
        self.tasks: dict[int, TaskId] = {}  #: by request, oldest first: the newest tasks sent
        #: (request, task) of tasks whose ids central has not sent to this connection.
        self.unconfirmed: list[tuple[int, TaskId]] = []
        self.waits: dict[int, Blocking] = {}  #: by request: waits during which it does nothing else
        self.unchecked_waits: dict[int, Blocking] = {}  #: by request: not checked for deadlocks
        #: By request: revoked claims of which its module has not been notified.
        self.lost_claims: dict[int, LostClaim] = {}

    def remember_task(self, number: int, task: TaskId) -> None:
        """Remember the task of request *number*. Later requests may name the task by *number*."""
        tasks = self.tasks
        tasks[number] = task
        if len(tasks) > REMEMBERED_TASKS:
            del tasks[next(iter(tasks))]


class Connection(Asker):
    """One socket of a module. As a slot, it also handles messages: one thread of a resource."""

    __slots__ = (
        "acts_known_until",
        "handling",
        "hang_timers",
        "hung_after",
        "maybe_unstarted",
        "next_began_at",
        "prefetch",
        "resource",
        "was_replaced",
    )

    def __init__(
        self, connection_id: ConnectionId, session: str, module: "Module", number: int
    ) -> None:
        Asker.__init__(self, connection_id, session, module, number)
        #: None for the module's own connection, which handles nothing.
        self.resource: ModuleResource | None = None
        #: By delivery, oldest first: the last event in which its handler may not have begun.
        self.handling: dict[Delivery, int] = {}
        self.prefetch = 0  #: number of messages that it accepts before it is free
        #: The present delivery, if it was prefetched and may not have begun.
        self.maybe_unstarted: Delivery | None = None
        #: When it began the first of its prefetched messages, by its report (0: not reported).
        self.next_began_at = 0.0
        #: Central knows what the slot did until this time. Earlier reported times are raised to it.
        self.acts_known_until = 0.0
        #: Seconds after which a handler that is no longer needed counts as hung (0: never)
        self.hung_after = 0.0
        #: By delivery: the timers of handlers that should return soon.
        self.hang_timers: dict[int, Timer] = {}
        self.was_replaced = False  #: whether its handler hung, and another slot replaced it

    @property
    def has_room(self) -> bool:
        """Whether the slot handles nothing but nested deliveries."""
        return not self.handling or all(one.nested for one in self.handling)

    def to_central_time(self, now: float, ago: float) -> float:
        """Return central's time of an event that was *ago* seconds ago by the connection's clock.

        The result is between ``acts_known_until`` and *now*.
        """
        return min(now, max(self.acts_known_until, now - ago))


class Module(Stored):
    """A connected program. It exists as long as it has a connection."""

    __slots__ = (
        "called",
        "cancels_on_leave",
        "connections",
        "handlers",
        "incarnation",
        "is_ready",
        "name",
        "principal",
        "process",
        "resources",
        "retained",
    )

    def __init__(
        self, name: str, called: str, incarnation: str, process: str, principal: str = ""
    ) -> None:
        self.name = name  #: unique among connected modules
        self.called = called  #: its own name, which several copies of a program share
        self.incarnation = incarnation
        self.process = process
        #: Its owner: a key's name, "uid:N", or "" for the user of central itself.
        self.principal = principal
        self.connections: dict[str, Connection] = {}  #: by session
        self.resources: dict[str, ModuleResource] = {}
        self.handlers: dict[str, Handler] = {}  #: by message name
        self.cancels_on_leave = False  #: whether its top-level tasks are cancelled when it leaves
        self.is_ready = False  #: whether it has made the attachments of its start
        self.retained: dict[int, None] = {}  #: ids of tasks, living or ended, to retain for it

    @property
    def holder(self) -> "Holder":
        """This run of the module, as the owner of attachments."""
        return Holder(self.name, self.called, self.incarnation)

    @property
    def has_slots(self) -> bool:
        """Whether any of its resources has a slot."""
        return any(resource.capacity for resource in self.resources.values())


class Handler(Stored):
    """A module's handler of a message, in one of its resources."""

    __slots__ = (
        "accepts",
        "busy",
        "message",
        "module",
        "pending",
        "pool",
        "refuses",
        "resource",
        "takes",
    )

    def __init__(
        self,
        message: "MessageType",
        module: Module,
        resource: ModuleResource,
        declared: HandlerFormat,
    ) -> None:
        self.message = message
        self.module = module
        self.resource = resource
        self.pool = declared.pool  #: handlers of one pool share the messages
        #: Number of messages that may wait for it (0: no limit). It is 1 for a variable, of which
        #: only the newest value is useful.
        self.pending = 1 if message.message_class.keeps_value else declared.pending
        self.accepts = declared.accepts  #: whether it accepts each task with a call
        self.takes = tuple(declared.takes)  #: transitions of clients that it decides about
        self.refuses = tuple(declared.refuses)  #: transitions that central refuses for it
        self.busy = declared.busy  #: what happens to a task that must wait for this handler

    @property
    def is_custom(self) -> bool:
        """Whether it differs from a usual handler in the life cycle or the queue of its tasks."""
        return self.accepts or bool(self.takes or self.refuses) or self.busy is not Busy.QUEUE


class Declared(Stored):
    """The declaration of a message, and what follows from it."""

    __slots__ = (
        "declarers",
        "fans_out",
        "first_declared_by",
        "format",
        "initial_state",
        "is_goal",
        "is_interval_monitor",
        "is_notice",
        "message_class",
        "name",
        "parts",
        "running_state",
    )

    def __init__(self, declared: MessageFormat, by: str) -> None:
        self.redefine(declared, by)
        self.declarers: dict[str, None] = {}  #: incarnations of the modules that declared it

    def redefine(self, declared: MessageFormat, by: str) -> None:
        """Replace the format. All modules that declared the old format have disconnected."""
        self.format = declared
        self.name = declared.name
        self.parts = declared.parts
        self.message_class = declared.message_class
        self.is_goal = declared.message_class.is_goal
        cycle = self.life_cycle
        self.initial_state, self.running_state = cycle.initial, cycle.accepted.target
        self.is_interval_monitor = declared.message_class.is_interval_monitor
        self.is_notice = declared.name in NOTICES
        self.fans_out = declared.message_class.fans_out
        self.first_declared_by = by

    @property
    def title(self) -> str:
        """The class and name for use in texts, such as "goal 'walk'"."""
        return f"{self.message_class} '{self.name}'"

    @property
    def life_cycle(self) -> LifeCycle:
        """The life cycle of its tasks."""
        return read_life_cycle(self.format.life_cycle)


class Served(Declared):
    """A declared message with its handlers, the deliveries that wait for a handler, and counts."""

    __slots__ = (
        "awaited_by",
        "candidates",
        "custom_handlers",
        "delivered",
        "dropped",
        "failed",
        "handlers",
        "serving",
        "waiting",
    )

    def __init__(self, declared: MessageFormat, by: str) -> None:
        Declared.__init__(self, declared, by)
        self.handlers: list[Handler] = []  #: newest last
        self.candidates: tuple[ModuleResource, ...] = ()
        """The resources that may handle it: those of the newest handler and its pool."""
        self.serving = 0  #: number of handlers that have a slot
        self.custom_handlers = 0  #: number of handlers with ``is_custom``
        #: By id, oldest first: deliveries for which there is no handler.
        self.waiting: dict[int, Delivery] = {}
        self.awaited_by: dict[PresenceWait, None] = {}  #: waits until the message has a handler
        self.delivered = 0  #: number of deliveries to handlers
        self.failed = 0  #: number of failures
        self.dropped = 0  #: number of messages, and of copies for one receiver, that were dropped

    def add_handler(self, handler: "Handler") -> None:
        """Add a handler, the newest one."""
        self.handlers.append(handler)
        self.custom_handlers += handler.is_custom
        self._find_candidates()

    def remove_handler(self, handler: "Handler") -> None:
        """Remove a handler."""
        self.handlers.remove(handler)
        self.custom_handlers -= handler.is_custom
        self._find_candidates()

    def _find_candidates(self) -> None:
        """Find the resources of the newest handler and its pool."""
        pool = self.handlers[-1].pool if self.handlers else ""
        chosen = [one for one in self.handlers if one.pool == pool] if pool else self.handlers[-1:]
        self.candidates = tuple(handler.resource for handler in reversed(chosen))


class MessageType(Served):
    """A declared message: format, handlers, and attachments."""

    __slots__ = ("attached", "taps")

    def __init__(self, declared: MessageFormat, by: str) -> None:
        Served.__init__(self, declared, by)
        self.attached: list[AttachedHandler] = []  #: exception handlers of all its tasks
        self.taps: list[Wiretap] = []  #: oldest first


class PresenceWait(Stored):
    """A connection's wait until several messages have handlers at the same time."""

    __slots__ = ("connection", "messages", "missing", "number", "origin", "promised")

    def __init__(
        self, connection: Connection, header: WaitUntilHandled, messages: Iterable[MessageType]
    ) -> None:
        self.connection, self.number, self.origin = connection, header.number, header.origin
        #: Messages that its module will handle when the wait is over.
        self.promised = tuple(header.promised)
        self.messages = tuple(messages)
        #: Number of messages without a handler that has a slot.
        self.missing = sum(not message.serving for message in self.messages)
        for message in self.messages:
            message.awaited_by[self] = None

    @property
    def size(self) -> int:
        """The bytes that the wait holds."""
        return presence_size(self.messages)

    def end(self) -> None:
        """End the wait."""
        for message in self.messages:
            del message.awaited_by[self]


def presence_size(messages: Sequence[MessageType]) -> int:
    """Return the bytes that a wait for these messages would hold."""
    return WAIT_BYTES + AWAITED_BYTES * len(messages)


class Attachable(Protocol):
    """A task or message type, to which exception handlers and wiretaps are attached."""

    @property
    def attached(self) -> "list[AttachedHandler]":
        """Its exception handlers, newest last."""

    @property
    def taps(self) -> "list[Wiretap]":
        """Its own wiretaps, oldest first."""


class Holder(NamedTuple):
    """A run of a program that has attached an exception handler or wiretap."""

    name: str  #: the module's name, unique among connected modules
    called: str  #: the program's own name
    run: str  #: the incarnation


class AttachedHandler(Stored):
    """An exception handler, attached to a task or to all tasks of a message."""

    __slots__ = ("by", "failure", "handler", "holders", "id", "maximum", "place")

    def __init__(
        self,
        number: int,
        failure: str,
        handler: MessageType,
        maximum: int,
        place: Attachable,
        by: str,
    ) -> None:
        self.id = number  #: newer ones have higher ids
        self.failure = failure  #: the failure that it handles; "" for any
        self.handler = handler
        self.maximum = maximum  #: number of calls allowed per task; 0: any number
        self.place = place  #: the task or message that it is attached to
        self.by = by  #: own name of the module that attached it
        #: By module name: the programs' copies that have attached the same, the newest last.
        self.holders: dict[str, Holder] = {}


class Wiretap(Stored):
    """A wiretap: it sends its listener at an event, or before a moment of the tapped task.

    Before a start, the tapped task waits until the listener has ended its own such interval.
    """

    __slots__ = (
        "at",
        "condition",
        "has_fired",
        "held_moment",
        "holders",
        "id",
        "listener",
        "place",
        "watch",
    )

    def __init__(
        self, tap_id: int, condition: Condition, listener: MessageType, place: Attachable
    ) -> None:
        self.id = tap_id
        self.condition = condition
        self.listener = listener
        self.place = place  #: the task or message that it taps
        self.held_moment = 0  #: the moment of the tapped task that it holds back (0: none)
        self.at = 0  #: the event or moment at which the listener is sent, if it holds no moment
        self.has_fired = False  #: of a task's own wiretap: whether it has sent its listener
        self.watch: WatchOptions | None = None  #: options of a listener that is a monitor
        #: By name: the modules that added it and have not removed it.
        self.holders: dict[str, Holder] = {}

    @property
    def is_heard(self) -> bool:
        """Whether its listener can be sent: it has a handler, or is a monitor and needs none."""
        return bool(self.listener.handlers) or self.listener.message_class.is_monitor


class Context(Protocol):
    """The reason for a message that central has made (model/contexts.py)."""

    @property
    def header(self) -> Trouble | Tapped | Watching:
        """The context that the handler gets."""


class Queued(Stored):
    """A message's place in queues, and the slot that handles it."""

    __slots__ = ("arrival", "has_begun", "nested", "priority", "queues", "since", "slot", "ticket")

    def __init__(self) -> None:
        self.priority = 0
        self.arrival = 0  #: rank among equal priorities, also after it is queued again
        #: When its present wait (for its start, a slot or a handler) or its handling began.
        self.since = 0.0
        self.ticket = 0  #: queue entries with another ticket are void
        #: The resources in whose queues it waits; () without a handler; None: in no queue.
        self.queues: tuple[ModuleResource, ...] | None = None
        self.slot: Connection | None = None  #: the connection whose thread handles it
        self.has_begun = False  #: whether its handler has sent a request
        self.nested = False  #: whether it is beyond the capacity: in a wait, or replied to later


class Delivery(Queued):
    """One message on its way to one handler: its content, origin and reason."""

    is_task = False

    __slots__ = (
        "body",
        "context",
        "handling_id",
        "id",
        "message",
        "message_id",
        "number",
        "origin",
        "refused",
        "role",
        "sender",
        "sent_by",
        "tap_depth",
    )

    def __init__(
        self, delivery_id: int, message: MessageType, body: bytes, sender: Connection | None
    ) -> None:
        Queued.__init__(self)
        # The three ids are one number, except for copies and retries.
        self.id = delivery_id
        self.handling_id = delivery_id  #: in packets to and from handlers; a retry gets a new one
        self.message_id = delivery_id  #: the same for all copies, one for each receiver
        self.message = message
        self.body = body
        self.role = Role.NONE  #: why central made it; NONE if a module sent it
        self.context: Context | None = None  #: the details of that reason
        self.sender = sender  #: the connection that gets the answer; None if there is none
        #: The module that sent it. For a message that central made about another message: the
        #: module that sent the other message, or None.
        self.sent_by: object = sender.module if sender is not None else None
        self.tap_depth = 0  #: number of wiretaps' listeners among its causes, itself included
        #: The delivery whose handler sent it (0: none, or unknown); not set for tasks.
        self.origin = 0
        self.number = 0  #: the number of the sender's request (0: no answer wanted)
        self.refused = NOTHING_REFUSED  #: refusals of unconfirmed tasks that its handler sent

    def __repr__(self) -> str:
        return f"{self.message.name} {{{self.id}}}"

    @property
    def copy_of(self) -> int:
        """The id of the message of which this is one receiver's copy; 0 for the original."""
        return self.message_id if self.message_id != self.id else 0

    @property
    def is_stranded(self) -> bool:
        """Whether it is an exception handler without a handler."""
        return self.role is Role.EXCEPTION and not self.message.handlers

    def withdraw(self) -> None:
        """Leave all queues. The new ticket makes the entries void."""
        self.ticket += 1
        for resource in self.queues or ():
            resource.leave_queue(self)
            if resource.limits and (limit := resource.limits.get(self.message.name)):
                limit.remove(self)
        self.queues = None


ModuleClaim = Claim[Connection, Delivery]
"""A lock or reservation of a module's resource."""
