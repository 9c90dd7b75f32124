"""Messages on their way: modules and their connections, message types, their handlers, and what is
attached to them.

Knows nothing of tasks, time or sockets.
"""

from collections import deque
from collections.abc import Iterable, Sequence
from typing import NamedTuple, Protocol

from tca_central.events import ConnectionId
from tca_central.model.budget import AWAITED_BYTES, WAIT_BYTES
from tca_central.model.clock import Timer
from tca_central.model.resources import Claim, PendingLimit, Resource
from tca_central.model.rights import Rights
from tca_central.model.stored import Stored
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
from tca_wire.packets.routes import Entrance
from tca_wire.points import TaskId
from tca_wire.vocabulary import Busy, Condition, Role

REMEMBERED_TASKS = 128
"""Tasks kept per connection that it may name by the requests that sent them."""

TOLD_TOGETHER = 32
"""Quiet tasks of which a connection is told at once, if it gets no other answer before."""


class ModuleResource(Resource["Connection", "Delivery"]):
    """A resource of a module: its slots are connections, and deliveries wait for them."""

    __slots__ = ("busy", "delivered", "limits", "quick_runs", "replaced")

    def __init__(self, module: str, name: str) -> None:
        super().__init__(module, name)
        self.limits: dict[
            str, PendingLimit[Delivery]
        ] = {}  #: by message name, of handlers that have one
        self.delivered = 0  #: number of messages that were given to it
        self.busy = 0.0  #: seconds in which they were handled, added up over its slots
        self.replaced = 0  #: number of slots that were lost because their handlers hung
        self.quick_runs = 0  #: number of messages, one after the other, that were handled quickly


class LostClaim(NamedTuple):
    """A lock or reservation that was taken away."""

    delivery: int  #: whose handler had it (0: no handler's)
    resource: str
    text: str  #: by whom, or why


class Blocking(NamedTuple):
    """A wait: a connection, or the coroutine of a handler, does nothing until its request is
    answered.
    """

    origin: int  #: the delivery whose handler waits (0: none)
    since: int  #: the event in which that began
    at: float  #: and its time
    together: tuple[
        int, ...
    ] = ()  #: of several: all of them; it goes on when one of them is answered
    is_coroutine: bool = False


class Line(Stored):
    """Who a connection is, and what was under way when its line broke."""

    __slots__ = (
        "id",
        "late",
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
        self.principal = module.principal  #: who it belongs to
        self.rights: Rights | None = None  #: what it may do (None: everything)
        self.session = session  #: names it across reconnects
        self.number = number  #: which of its module's it is
        self.module = module
        self.pulse = b""  #: of its process, for the server
        self.repeats_until = (
            0  #: answers of deliveries up to this one may come again: the connection had broken
        )
        self.orphans: list[int] = []  #: deliveries it had when it was lost, to be cancelled
        self.late: dict[
            int, str
        ] = {}  #: the newest of these whose answers may still come, and what to say then


class Asker(Line):
    """What a connection has asked for: requests, their answers, and its waits."""

    __slots__ = (
        "answer_bytes",
        "answers",
        "last_number",
        "lost_claims",
        "outstanding",
        "pauses",
        "tasks",
        "untold",
        "waits",
    )

    def __init__(
        self, connection_id: ConnectionId, session: str, module: "Module", number: int
    ) -> None:
        Line.__init__(self, connection_id, session, module, number)
        self.last_number = 0  #: the highest request number seen
        self.outstanding: dict[
            int, Stored
        ] = {}  #: requests whose answer is due -> the delivery or wait behind it
        self.answers: deque[int] = (
            deque()
        )  #: requests whose answers are kept, oldest first: see model/answers.py
        self.answer_bytes = 0  #: that these hold
        self.tasks: dict[int, TaskId] = {}  #: the newest that it has sent, by request, oldest first
        self.untold: list[
            tuple[int, TaskId]
        ] = []  #: those of which it is to be told, with their requests
        self.waits: dict[
            int, Blocking
        ] = {}  #: requests for whose answer it does nothing else, by number
        self.pauses: dict[
            int, Blocking
        ] = {}  #: such waits that soon end by themselves: no deadlocks
        self.lost_claims: dict[
            int, LostClaim
        ] = {}  #: taken from it, and it does not know yet, by the Lock's number

    def remember_task(self, number: int, task: TaskId) -> None:
        """Keep the task that a request has sent: others may name it so."""
        tasks = self.tasks
        tasks[number] = task
        if len(tasks) > REMEMBERED_TASKS:
            del tasks[next(iter(tasks))]


class Slot(Asker):
    """What a connection handles: the thread of one resource."""

    __slots__ = (
        "begins",
        "doubts",
        "handling",
        "hung_after",
        "known_until",
        "prefetch",
        "resource",
        "unbegun",
        "was_replaced",
    )

    def __init__(
        self, connection_id: ConnectionId, session: str, module: "Module", number: int
    ) -> None:
        Asker.__init__(self, connection_id, session, module, number)
        self.resource: ModuleResource | None = (
            None  #: None: it is the module's own, and handles nothing
        )
        self.handling: dict[
            Delivery, int
        ] = {}  #: its deliveries -> the event in which it got each; oldest first
        self.prefetch = 0  #: number of messages that it takes ahead, before it is free
        self.unbegun: Delivery | None = (
            None  #: it had this ahead, and had not begun it when that was given to it
        )
        self.begins = 0.0  #: when it began what it has ahead (0: when that is given to it)
        self.known_until = 0.0  #: no run of a handler of which it tells later began or ended before
        self.hung_after = (
            0.0  #: seconds after which a handler hangs that nobody waits for (0: never)
        )
        self.doubts: dict[
            int, Timer
        ] = {}  #: by delivery, when that is so of those that are to return
        self.was_replaced = False  #: its handler hung, and another took its place

    @property
    def has_room(self) -> bool:
        """Whether it handles nothing, but what it was given while it waited."""
        return not self.handling or all(one.nested for one in self.handling)

    def then(self, now: float, ago: float) -> float:
        """Central's time when something was, so long ago by the clock of this connection."""
        return min(now, max(self.known_until, now - ago))


class Connection(Slot):
    """One socket of a module, with all that it is and does; and whom it reaches directly."""

    __slots__ = ("entrance", "licence", "routes", "watchers", "watches")

    def __init__(
        self, connection_id: ConnectionId, session: str, module: "Module", number: int
    ) -> None:
        Slot.__init__(self, connection_id, session, module, number)
        self.entrance: Entrance | None = None  #: where this slot takes messages directly
        self.licence = 0  #: to send directly (0: it has none)
        self.routes: dict[MessageType, None] = {}  #: messages of whose routes it is told
        self.watches: dict[Connection, None] = {}  #: slots whose end it is told of
        self.watchers: dict[Connection, None] = {}  #: the connections told of this slot's end


class Module(Stored):
    """A connected program. It is there as long as one of its connections is."""

    __slots__ = (
        "called",
        "connections",
        "handlers",
        "incarnation",
        "is_ready",
        "keeps",
        "name",
        "principal",
        "process",
        "resources",
    )

    def __init__(
        self, name: str, called: str, incarnation: str, process: str, principal: str = ""
    ) -> None:
        self.name = name  #: unique among those connected
        self.called = called  #: its own name: several copies of a program share it
        self.incarnation = incarnation
        self.process = process
        self.principal = (
            principal  #: who runs it: a key's name, "uid:N", "" for the user who runs central
        )
        self.connections: dict[str, Connection] = {}  #: by session
        self.resources: dict[str, ModuleResource] = {}
        self.handlers: dict[str, Handler] = {}  #: by message name
        self.is_ready = False  #: it has attached what it attaches at its start
        self.keeps: dict[
            int, None
        ] = {}  #: ids of the tasks, living or ended, that it wants remembered

    @property
    def holder(self) -> "Holder":
        """This run, as one that attaches something."""
        return Holder(self.name, self.called, self.incarnation)

    @property
    def has_slots(self) -> bool:
        """Whether any thread of it handles messages, or may."""
        return any(resource.capacity for resource in self.resources.values())


class Handler(Stored):
    """A module's handler of a message, in one of its resources."""

    __slots__ = (
        "accepts",
        "busy",
        "direct",
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
        #: So many messages may wait for it (0: no limit of its own); of a variable only the newest
        #: value is wanted.
        self.pending = 1 if message.message_class.keeps_value else declared.pending
        self.direct = (
            declared.direct
        )  #: senders may do without central, where nothing speaks against it
        self.accepts = declared.accepts  #: says itself when it accepts a task
        self.takes = tuple(declared.takes)  #: the transitions of clients that it decides about
        self.refuses = tuple(declared.refuses)  #: those that are refused in its name
        self.busy = declared.busy  #: what becomes of a task that has to wait for it

    @property
    def has_wishes(self) -> bool:
        """Whether a task's life goes otherwise than with any handler."""
        return self.accepts or bool(self.takes or self.refuses) or self.busy is not Busy.QUEUE


class Declared(Stored):
    """What a message was declared as, and what follows from that."""

    __slots__ = (
        "declarers",
        "fans_out",
        "first_declared_by",
        "format",
        "initial",
        "is_aside",
        "is_goal",
        "is_notice",
        "message_class",
        "name",
        "parts",
        "running",
    )

    def __init__(self, declared: MessageFormat, by: str) -> None:
        self.redefine(declared, by)
        self.declarers: dict[str, None] = {}  #: incarnations of the modules that declared it

    def redefine(self, declared: MessageFormat, by: str) -> None:
        """Take a format; those who declared another are gone."""
        self.format = declared
        self.name = declared.name
        self.parts = declared.parts
        self.message_class = declared.message_class
        self.is_goal = declared.message_class.is_goal
        self.initial, self.running = self.life_cycle.initial, self.life_cycle.accepted.target
        self.is_aside = declared.message_class.is_aside
        self.is_notice = declared.name in NOTICES
        self.fans_out = declared.message_class.fans_out
        self.first_declared_by = by

    @property
    def title(self) -> str:
        """For people: "goal 'walk'"."""
        return f"{self.message_class} '{self.name}'"

    @property
    def life_cycle(self) -> LifeCycle:
        """The life cycle of its tasks."""
        return read_life_cycle(self.format.life_cycle)


class Served(Declared):
    """A declared message with those who handle it, what waits for a handler, and counts of both."""

    __slots__ = (
        "awaited_by",
        "candidates",
        "delivered",
        "dropped",
        "failed",
        "handlers",
        "serving",
        "waiting",
        "wishes",
    )

    def __init__(self, declared: MessageFormat, by: str) -> None:
        Declared.__init__(self, declared, by)
        self.handlers: list[Handler] = []  #: newest last
        self.candidates: tuple[ModuleResource, ...] = ()
        """The resources that may handle it: of the newest handler and of those in its pool."""
        self.serving = 0  #: number of handlers that have a slot to be called in
        self.wishes = 0  #: number of handlers that have some (Handler.has_wishes)
        self.waiting: dict[
            int, Delivery
        ] = {}  #: deliveries that no handler is there for, oldest first
        self.awaited_by: dict[PresenceWait, None] = {}  #: waits until it is handled
        self.delivered = 0  #: how often a handler got it
        self.failed = 0  #: how often one failed
        self.dropped = 0  #: how many came to nothing, or were not brought to a receiver

    def add_handler(self, handler: "Handler") -> None:
        """A newer handler."""
        self.handlers.append(handler)
        self.wishes += handler.has_wishes
        self._find_candidates()

    def remove_handler(self, handler: "Handler") -> None:
        """A handler is gone."""
        self.handlers.remove(handler)
        self.wishes -= handler.has_wishes
        self._find_candidates()

    def _find_candidates(self) -> None:
        pool = self.handlers[-1].pool if self.handlers else ""
        chosen = [one for one in self.handlers if one.pool == pool] if pool else self.handlers[-1:]
        self.candidates = tuple(handler.resource for handler in reversed(chosen))


class MessageType(Served):
    """A declared message: its format and handlers, what is attached to it, and who may send it
    directly.
    """

    __slots__ = ("attached", "route", "senders_told", "taps")

    def __init__(self, declared: MessageFormat, by: str) -> None:
        Served.__init__(self, declared, by)
        self.attached: list[
            AttachedHandler
        ] = []  #: exception handlers of each of its tasks, newest last
        self.taps: list[Wiretap] = []  #: oldest first
        self.route: tuple[Connection, ...] = ()  #: slots to which it may be sent directly
        self.senders_told: dict[Connection, None] = {}  #: senders that know the route


class PresenceWait(Stored):
    """A connection waits until each of some messages is handled, all at the same time."""

    __slots__ = ("connection", "messages", "missing", "number", "origin", "promised")

    def __init__(
        self, connection: Connection, header: WaitUntilHandled, messages: Iterable[MessageType]
    ) -> None:
        self.connection, self.number, self.origin = connection, header.number, header.origin
        self.promised = tuple(
            header.promised
        )  #: messages that will be handled when this wait is over
        self.messages = tuple(messages)
        self.missing = sum(
            not message.serving for message in self.messages
        )  #: number of those that nobody handles
        for message in self.messages:
            message.awaited_by[self] = None

    @property
    def size(self) -> int:
        """Bytes that it holds."""
        return presence_size(self.messages)

    def end(self) -> None:
        """Nobody waits any more."""
        for message in self.messages:
            del message.awaited_by[self]


def presence_size(messages: Sequence[MessageType]) -> int:
    """Bytes that a wait until messages are handled holds."""
    return WAIT_BYTES + AWAITED_BYTES * len(messages)


class Attachable(Protocol):
    """A task or a message: what exception handlers and wiretaps are attached to."""

    @property
    def attached(self) -> "list[AttachedHandler]":
        """Its exception handlers, newest last."""

    @property
    def taps(self) -> "list[Wiretap]":
        """Its own wiretaps, oldest first."""


class Holder(NamedTuple):
    """A run of a program that has attached something."""

    name: str  #: its module's, unique among those connected
    called: str  #: the program's own
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
        self.failure = failure  #: "" for any
        self.handler = handler
        self.maximum = maximum  #: of its calls for one task; 0: any number
        self.place = place  #: that it is attached to
        self.by = by  #: the own name of the module that attached it
        self.holders: dict[
            str, Holder
        ] = {}  #: by name: the run that did, and those of its copies that had before


class Wiretap(Stored):
    """A wiretap: the listener is sent *before* some moments, which it holds back, or *at*
    others.
    """

    __slots__ = (
        "at",
        "before",
        "condition",
        "has_fired",
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
        self.place = place  #: that it taps
        self.before = 0
        self.at = 0
        self.has_fired = False  #: of one task: has sent its listener
        self.watch: WatchOptions | None = None  #: how a listener that is a monitor watches
        self.holders: dict[
            str, Holder
        ] = {}  #: by name: the modules that added it and have not taken it away

    @property
    def is_heard(self) -> bool:
        """Whether its listener is sent: somebody handles it, or it is a monitor, which watches by
        itself.
        """
        return bool(self.listener.handlers) or self.listener.message_class.is_monitor


class Refusals(NamedTuple):
    """Quiet tasks that the handler of a delivery has sent, and that were refused."""

    delivery: int = 0
    number: int = 0
    text: str = ""  #: of the last one


NOTHING_REFUSED = Refusals()


class Context(Protocol):
    """The reason for a message that central has made: see model/contexts.py."""

    @property
    def header(self) -> Trouble | Tapped | Watching:
        """What the handler is told of it."""


class Queued(Stored):
    """What waits for a slot, and then has one: its place in the queues, and who handles it."""

    __slots__ = ("arrival", "nested", "priority", "queues", "since", "slot", "ticket")

    def __init__(self) -> None:
        self.priority = 0
        self.arrival = 0  #: when it could first be handled; kept when it has to queue again
        self.since = 0.0  #: when it last began to wait in a queue or for a handler, or to be handled; of a task, to be
        self.ticket = 0  #: place in the queues; a queue entry with another ticket is void
        self.queues: tuple[ModuleResource, ...] | None = (
            None  #: where it waits; (): for a handler, None: nowhere
        )
        self.slot: Connection | None = None  #: the connection whose thread handles it
        self.nested = False  #: handled inside a wait of its slot's own, beyond the capacity


class Delivery(Queued):
    """One message on its way to one handler: what it is, where it comes from, and why."""

    is_task = False

    __slots__ = (
        "body",
        "context",
        "given_as",
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
        self.id = delivery_id
        self.given_as = (
            delivery_id  #: the number under which a handler has it; another one each time
        )
        self.message_id = delivery_id
        self.message = message
        self.body = body
        self.role = Role.NONE  #: why central made it
        self.context: Context | None = None  #: the reason for it, if central made it
        self.sender = sender  #: the receiver of the answer; None when it is gone
        self.sent_by: object = sender.module if sender is not None else None
        """The module that sent it; if central made it, the sender of the message it was made for
        (None: nobody).
        """
        self.tap_depth = 0  #: number of wiretaps' listeners among its causes, it included
        self.origin = 0  #: unless it is a task: the delivery whose handler sent it (0: nobody's, or not known)
        self.number = 0  #: of the sender's request (0: no answer wanted)
        self.refused = NOTHING_REFUSED  #: what its handler has sent quietly, in vain

    def __repr__(self) -> str:
        return f"{self.message.message_class} {self.id} '{self.message.name}'"

    @property
    def copy_of(self) -> int:
        """The message that it is a copy of, for one receiver; 0 if it is the message's own."""
        return self.message_id if self.message_id != self.id else 0

    @property
    def is_stranded(self) -> bool:
        """Whether it is an exception handler that nobody handles."""
        return self.role is Role.EXCEPTION and not self.message.handlers

    def withdraw(self) -> None:
        """Leave the queues."""
        self.ticket += 1
        for resource in self.queues or ():
            resource.leave_queue(self)
            if resource.limits and (limit := resource.limits.get(self.message.name)):
                limit.remove(self)
        self.queues = None


ModuleClaim = Claim[Connection, Delivery]
"""A lock or reservation of a module's resource."""
