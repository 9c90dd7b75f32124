"""The records of the oracle, and the facts that central recorded for the current event."""

from collections import Counter
from dataclasses import dataclass, field
from typing import Any, TypeGuard

from tca_central.events import Effect, Record, Transmit
from tca_wire.journal import facts
from tca_wire.journal.causes import TimeOver
from tca_wire.messages.failures import LOCK_LOST
from tca_wire.packets import headers
from tca_wire.points import Moment
from tca_wire.vocabulary import CENTRAL, Condition, MessageClass, Refusal, Role

SH, EH, SP, EP, SA, EA = tuple(Moment)
STARTS = {SH, SP, SA}


Family = tuple[int, str, int]
"""The key of siblings that constraint flags relate: the parent, and under the root also the module
and its run.
"""


class Disagreement(AssertionError):
    """Central and the oracle differ."""


@dataclass(eq=False)
class Job:
    """A message on its way to one handler."""

    id: int
    message: str
    kind: MessageClass
    sender: str = ""  # the sending connection
    module: str = ""  # of the sender; if central made the message, of its cause
    number: int = 0  # of the sender's request, if an answer is due
    priority: int = 0
    role: Role = Role.NONE
    sent_for_listener: bool = False  # sent by a monitor that is itself a listener
    target: tuple[str, str] | None = None  # the only resource that may handle it, if it is a copy
    wanted: bool = True  # is to be delivered
    waiting: bool = False  # is queued: only a slot is missing
    since: tuple[int, int] = (0, 0)  # start of its wait (step, round)
    arrival: tuple[int, int] | None = None  # first start of its wait; None after it lost its place
    slot: str = ""  # the handling connection
    handling_id: int = 0
    nested: bool = False  # handled within the wait of its slot's handler
    host: "Job | None" = None  # if nested: the message whose handler waits meanwhile
    is_postponed: bool = False  # its handler has returned, and replies later
    frees_slot: bool = False  # its slot handles any message until then
    turn: int = 0  # its rank among all deliveries
    origin: int = 0  # the delivery whose handler sent it
    about: "Job | None" = None  # its cause, if central made it
    tap: "Tap | None" = None  # of a listener: its wiretap


@dataclass(eq=False)
class Node(Job):
    """A task."""

    parent: "Node | None" = None
    run: int = 0  # number of the sender's run
    past: set[Moment] = field(default_factory=set)
    free: bool = False  # may start before its parent
    survives: bool = False  # a kill of its parent does not kill it
    delayed: bool = False  # its planning starts no earlier than its achieving
    suspended: bool = False
    killed: bool = False
    returned: bool = False  # its handler has returned for good
    again: bool = False  # is to be handled once more
    recovering: "Node | None" = None  # the exception handler for its handler's failure
    failing: "Trouble | None" = None  # of an exception handler: the failure it handles
    void: bool = False  # of an exception handler: its end decides nothing more
    resolved: bool = False  # of an exception handler: it has resolved its failure
    attached: list["Attachment"] = field(default_factory=list)
    calls: dict[float, int] = field(default_factory=dict)  # number of calls, by attachment
    termination_messages: list[str] = field(default_factory=list)
    taps: list["Tap"] = field(default_factory=list)
    fired: set[int] = field(default_factory=set)  # *before* taps that have fired
    unheard: set[int] = field(default_factory=set)  # taps in *fired* whose listener had no handler
    checks: list["Node"] = field(default_factory=list)  # listeners to be handled before its retry
    listeners: list["Node"] = field(default_factory=list)  # they are killed with this task
    watch: Any = None  # of a monitor
    watches_over: bool = False  # a background monitor
    is_foreign: bool = False  # a monitor not caused by its parent's handling
    asking: set["Node"] = field(default_factory=set)  # exception handlers that requested its retry
    policy: Any = None  # its retry policy
    noted_at: str = ""  # the slot that may handle it within a wait
    noted_for: list[Any] = field(default_factory=list)  # its resources when that was noted

    @property
    def is_goal(self) -> bool:
        return self.kind.is_goal

    @property
    def first(self) -> Moment:
        """Return the start that its handling begins with: planning for goals, achieving for
        commands.
        """
        return SP if self.is_goal else SA

    @property
    def is_eligible(self) -> bool:
        """Whether constraint flags of later siblings may refer to this task."""
        return not self.role and self.kind not in (
            MessageClass.POLLING_MONITOR,
            MessageClass.DEMON_MONITOR,
        )

    def lineage(self) -> list["Node"]:
        """Return the tasks from this one up to the top-level task."""
        found, node = [], self
        while node.parent is not None:
            found.append(node)
            node = node.parent
        return found


@dataclass(eq=False)
class Wait:
    """The wait of a connection for a point of a task."""

    node: Node
    moment: Moment
    origin: int = 0  # the delivery whose handler sent the request
    holds_back: int = 0  # the delivery whose handler does nothing else meanwhile
    coroutine: int = 0  # the delivery whose coroutine awaits it


@dataclass(eq=False)
class Claim:
    """The claim of a connection: granted, or pending."""

    id: int
    resource: tuple[str, str]
    sender: str
    number: int  # of the request
    module: str
    reserves: bool
    holder: Job | None = None  # the task or message whose handler claims
    priority: float = 0
    since: tuple[int, int] = (0, 0)
    arrival: tuple[int, int] = (0, 0)
    due: float = float("inf")  # when its timeout is over
    granted: bool = False


@dataclass(eq=False)
class Pair:
    """A constraint: *after* is reached no earlier than *delay* seconds after *before*. *due* is the
    end of this delay; it is set once *before* is reached.
    """

    before: tuple[Node, Moment] | None
    after: tuple[Node, Moment]
    delay: float = 0
    due: float | None = None


@dataclass(eq=False)
class Alarm:
    """A timer of a task: its deadline, its delayed kill, a monitor's end or (*is_test*) a monitor's
    next test, the end of a pause before a retry, or of the time of an attempt.
    """

    due: float
    step: int  # in which it was set
    node: Node
    moment: Moment | None = None  # of a deadline
    ending: "Ending | None" = None
    watch: Any = None
    is_test: bool = False
    is_pause: bool = False
    is_attempt: bool = False


@dataclass(eq=False)
class Ending:
    """A kill that waits for a point."""

    node: Node
    scope: str
    delay: float
    after: tuple[Node, Moment] | None = None


@dataclass(eq=False)
class Attachment:
    id: float
    failure: str
    handler: str
    maximum: int
    message: str  # attached to all tasks of this message; "": to one task
    by: str


@dataclass(eq=False)
class Trouble:
    """A failure, and where its present exception handler was found."""

    node: Node
    names: tuple[str, ...]
    at: Node
    attachment: Attachment
    passed: set[tuple[Attachment, str]]
    """Attachments whose exception handler could not decide, each with the failure's name. Failures
    inside an exception handler share the set with it.
    """

    @property
    def is_own(self) -> bool:
        """Whether the exception handler is attached to the task itself."""
        return not self.attachment.message


@dataclass(eq=False)
class Tap:
    id: int
    condition: Condition
    listener: str
    watch: Any = None  # options of a monitor
    has_fired: bool = False
    holders: set[str] = field(default_factory=set)


@dataclass(eq=False)
class Handler:
    module: str
    resource: str
    pool: str


@dataclass(eq=False)
class Collector:
    """A multi-query under way."""

    sender: str
    number: int
    wanted: int
    pending: list[Job]


class Seen:
    """The effects of central for one event. They decide what the rules leave open: the ids of new
    messages, and the order of equals.
    """

    def __init__(self, effects: list[Effect]) -> None:
        self.facts = [
            fact for effect in effects if isinstance(effect, Record) for fact in effect.entry.facts
        ]
        self.transmitted = [
            (effect.connection.decode(), effect.header)
            for effect in effects
            if isinstance(effect, Transmit)
        ]
        causes = [effect.entry.cause for effect in effects if isinstance(effect, Record)]
        self.due = [cause.about for cause in causes if isinstance(cause, TimeOver)]
        births = [fact for fact in self.facts if isinstance(fact, facts.Received)]
        self.sent = [birth for birth in births if birth.sender != "central"]
        self.made = [birth for birth in births if birth.sender == "central"]
        self.attached = [fact for fact in self.facts if isinstance(fact, facts.Attached)]
        slots = [
            connection
            for connection, header in self.transmitted
            if isinstance(header, headers.Deliver)
        ]
        next_slot = iter(slots)
        self.given = [
            (fact, next(next_slot) if isinstance(fact, facts.Delivered) else "")
            for fact in self.facts
            if is_delivery_or_grant(fact)
        ]
        refused = [
            (name, header)
            for name, header in self.transmitted
            if isinstance(header, headers.Refused)
        ]
        self.refused_retries = [
            fact
            for fact in self.facts
            if isinstance(fact, facts.RequestRefused) and fact.sender == CENTRAL
        ]
        self.retried = [
            (int(fact.task), fact.fallback)
            for fact in self.facts
            if isinstance(fact, facts.Retried) and fact.by == CENTRAL
        ]
        self.deadlocked = [
            (name, header.number) for name, header in refused if header.refusal is Refusal.DEADLOCK
        ]

    def place(self, task: int) -> int:
        """Return the position of a task among the tasks whose timers central has handled."""
        return self.due.index(task) if task in self.due else len(self.due)

    @property
    def is_refused(self) -> bool:
        return any(
            isinstance(fact, facts.RequestRefused)
            and fact.sender != CENTRAL
            and not is_deadlock(fact)
            for fact in self.facts
        )

    def take_refused_retry(self, task: int) -> bool:
        """Take central's refusal of a retry of its own, which would wait for itself."""
        found = self.refused_retries[:1]
        if found and found[0].text.partition(" can't")[0].endswith(f" {{{task}}}"):
            del self.refused_retries[0]
            return True
        return False

    def is_accepted_as(self, number: int) -> bool:
        return any(
            isinstance(header, headers.Accepted) and header.id == number
            for _, header in self.transmitted
        )

    def handling_id(self, task: int) -> int:
        """Return the number of a task's newest handling, which is given or queued in this event."""
        handlings = [
            fact.id
            for fact in self.facts
            if isinstance(fact, facts.Delivered | facts.Queued) and fact.message_id == task
        ]
        return max(handlings, default=0)

    def take_made_id(self, message: str, role: Role, parent: int, about: int, tap: int = 0) -> int:
        """Take the id of a message that central must have made."""
        fired = [
            fact.listener
            for fact in self.facts
            if isinstance(fact, facts.TapFired) and fact.tap == tap
        ]
        for birth in self.made:
            matches = (birth.message, birth.role, birth.parent, birth.about) == (
                message,
                role,
                parent,
                about,
            )
            if matches and (birth.id in fired or not tap):
                self.made.remove(birth)
                return birth.id
        raise Disagreement(
            f"central made no {role} '{message}' under {parent} about {about}: {self.made}"
        )


def is_deadlock(fact: object) -> bool:
    """Whether a fact ends a wait or claim, or raises a failure, because of a deadlock."""
    if isinstance(fact, facts.ClaimEnded):
        return fact.why.startswith(f"{Refusal.DEADLOCK}: ")
    if isinstance(fact, facts.Failed):
        return fact.failure == Refusal.DEADLOCK and fact.is_beside
    return isinstance(fact, facts.RequestRefused) and fact.refusal is Refusal.DEADLOCK


def is_lock_lost(fact: object) -> TypeGuard[facts.Failed]:
    """Whether a fact raises the loss of a lock on its task."""
    return isinstance(fact, facts.Failed) and fact.failure == LOCK_LOST and fact.is_beside


def is_delivery_or_grant(fact: object) -> bool:
    """Whether a fact delivers, grants, ends a deadlock or raises a lost lock."""
    return (
        isinstance(fact, facts.Delivered | facts.Granted) or is_deadlock(fact) or is_lock_lost(fact)
    )


class World:
    """The complete state of the oracle."""

    def __init__(self) -> None:
        self.time = 0.0  # of the event
        self.due_by = 0.0  # timers due up to this time have been handled
        self.step = self.round = self.turns = 0
        self.kinds: dict[str, MessageClass] = {}
        self.parts: dict[str, list[str]] = {}
        self.handlers: dict[str, list[Handler]] = {}  # newest last
        self.modules: dict[str, str] = {}  # by connection
        self.slots: dict[str, tuple[str, str]] = {}  # by connection, its resource: (module, name)
        self.root = Node(0, "root", MessageClass.GOAL, past=set(STARTS))
        self.nodes: dict[int, Node] = {}  # tasks that have not ended, oldest first
        self.jobs: list[Job] = []  # messages other than tasks
        self.ended_runs: Counter[str] = Counter()  # ended runs, by module
        self.last: dict[Family, Node] = {}  # the newest task that flags refer to
        self.pairs: list[Pair] = []
        self.alarms: list[Alarm] = []
        self.endings: list[Ending] = []
        self.attached: dict[str, list[Attachment]] = {}  # by message, newest last
        self.taps: dict[str, list[Tap]] = {}  # by message
        self.waits: dict[tuple[str, int], Wait] = {}
        self.collectors: list[Collector] = []
        self.claims: list[Claim] = []  # oldest first
        self.ended: set[int] = set()
        self.killed_tasks: set[int] = set()  # the killed ones of *ended*
        self.never_began: set[tuple[int, Moment]] = set()  # unreached starts of killed tasks
        self.unread = ("", 0)  # the event's request, while timers before it are handled
        self.resumed: list[Node] = []  # monitors that were resumed in this event
        self.spared: set[Node] = set()  # unhandled exception handlers, not skipped yet
        self.retried: list[tuple[int, str]] = []  # by policies in this event, with the fallback
        self.has_sent = False  # a wiretap has sent something since the last look
        self.seen = Seen([])

    def node(self, task: int) -> Node | None:
        return self.root if task == 0 else self.nodes.get(task)

    def children(self, parent: Node) -> list[Node]:
        return [node for node in self.nodes.values() if node.parent is parent]

    def subtree(self, node: Node) -> list[Node]:
        """Return a task and all below it, parents before children."""
        found = [node]
        for each in found:  # grows while it is walked
            found += self.children(each)
        return found

    def everything(self) -> list[Job]:
        return [*self.nodes.values(), *self.jobs]
