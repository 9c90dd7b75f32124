"""What the oracle knows: plain records and lists of them, and what was seen of central in the event
at hand.
"""

from collections import Counter
from dataclasses import dataclass, field
from typing import Any, TypeGuard

from tca_central.events import Effect, Record, Transmit
from tca_wire.journal import facts
from tca_wire.journal.causes import TimeOver
from tca_wire.messages.failures import LOCK_LOST
from tca_wire.packets import headers
from tca_wire.points import Moment
from tca_wire.vocabulary import Condition, MessageClass, Refusal, Role

SH, EH, SP, EP, SA, EA = tuple(Moment)
STARTS = {SH, SP, SA}


Family = tuple[int, str, int]
"""Tasks to which each other's flags may refer: by parent and, under the root, module and run of
it.
"""


class Disagreement(AssertionError):
    """Central and the oracle differ."""


@dataclass(eq=False)
class Job:
    """A message on its way to one handler."""

    id: int
    message: str
    kind: MessageClass
    sender: str = ""  # the connection that sent it
    module: str = ""  # of that; of what central made, of the message that it was made for
    number: int = 0  # of the sender's request, if an answer is due
    priority: int = 0
    role: Role = Role.NONE
    sent_for_listener: bool = False  # by a monitor that was sent for a wiretap
    target: tuple[str, str] | None = (
        None  # a copy's resource; others go to whoever handles their message
    )
    wanted: bool = True  # it shall be given to a handler
    waiting: bool = False  # nothing but the want of a slot keeps it from that
    since: tuple[int, int] = (0, 0)  # when it came to wait (step, round)
    arrival: tuple[int, int] | None = None  # the same for the first time, unless it lost its place
    slot: str = ""  # the connection that has it
    handling_id: int = 0
    nested: bool = False  # has a slot beyond the capacity
    turn: int = 0  # how many were given away when it was
    origin: int = 0  # the delivery whose handler sent it
    about: "Job | None" = None  # what central made it for
    tap: "Tap | None" = None  # for which it was sent


@dataclass(eq=False)
class Node(Job):
    """A task."""

    parent: "Node | None" = None
    run: int = 0  # of the module that sent it: how many namesakes had gone before
    past: set[Moment] = field(default_factory=set)
    free: bool = False  # need not wait until its parent starts
    survives: bool = False
    delayed: bool = False
    suspended: bool = False
    killed: bool = False
    returned: bool = False  # its handler has returned for good
    again: bool = False  # is to be handled once more
    recovering: "Node | None" = None
    failing: "Trouble | None" = None  # of an exception handler: what it handles
    void: bool = False
    resolved: bool = (
        False  # of an exception handler: if it ends well its failure has been dealt with
    )
    attached: list["Attachment"] = field(default_factory=list)
    calls: dict[int, int] = field(
        default_factory=dict
    )  # attachment -> how often it was called for this task
    parting: list[str] = field(default_factory=list)
    taps: list["Tap"] = field(default_factory=list)
    fired: set[int] = field(default_factory=set)  # taps that were fired before a moment of it
    unheard: set[int] = field(
        default_factory=set
    )  # those of them whose listener nobody handled then
    checks: list["Node"] = field(
        default_factory=list
    )  # listeners that are handled before it is handled once more
    listeners: list["Node"] = field(default_factory=list)  # that die with it
    watch: Any = None  # of a monitor
    watches_over: bool = False  # ends when there is nothing else left under its parent
    is_guest: bool = False  # a monitor that nothing which its parent's handler has sent put there
    asking: set["Node"] = field(default_factory=set)  # exception handlers that want it retried

    @property
    def is_goal(self) -> bool:
        return self.kind.is_goal

    @property
    def first(self) -> Moment:
        """The start that its handler waits for: goals are handled when they are planned, others
        when achieved.
        """
        return SP if self.is_goal else SA

    @property
    def is_eligible(self) -> bool:
        """Whether constraint flags may refer to it."""
        return not self.role and self.kind not in (
            MessageClass.POLLING_MONITOR,
            MessageClass.DEMON_MONITOR,
        )

    def lineage(self) -> list["Node"]:
        """From this task up to the one right under the root."""
        found, node = [], self
        while node.parent is not None:
            found.append(node)
            node = node.parent
        return found


@dataclass(eq=False)
class Claim:
    """That a connection has a resource for itself (*granted*), or waits for it."""

    id: int
    resource: tuple[str, str]
    sender: str
    number: int  # of its request
    module: str
    reserves: bool
    holder: Job | None = None  # for what it was made
    priority: float = 0
    since: tuple[int, int] = (0, 0)
    arrival: tuple[int, int] = (0, 0)
    due: float = float("inf")  # when it has waited long enough
    granted: bool = False


@dataclass(eq=False)
class Pair:
    """*after* is reached no earlier than *delay* after *before*; *due* is known once that is
    past.
    """

    before: tuple[Node, Moment] | None
    after: tuple[Node, Moment]
    delay: float = 0
    due: float | None = None


@dataclass(eq=False)
class Alarm:
    """Something that is due at a time for a task: a deadline, a kill, a monitor's end or
    (*is_test*) its next test.
    """

    due: float
    step: int  # in which it was set
    node: Node
    moment: Moment | None = None  # of a deadline
    ending: "Ending | None" = None
    watch: Any = None
    is_test: bool = False


@dataclass(eq=False)
class Ending:
    """A kill that waits for a point."""

    node: Node
    scope: str
    delay: float
    after: tuple[Node, Moment] | None = None


@dataclass(eq=False)
class Attachment:
    id: int
    failure: str
    handler: str
    maximum: int
    message: str  # of whose tasks; "": of one task
    by: str


@dataclass(eq=False)
class Trouble:
    """A failure, and where its present exception handler was found."""

    node: Node
    names: tuple[str, ...]
    at: Node
    attachment: Attachment
    passed: set[
        tuple[Attachment, str]
    ]  # that could not decide about failures so named, of this one and all below

    @property
    def is_own(self) -> bool:
        """Whether the exception handler is attached to the task itself."""
        return not self.attachment.message


@dataclass(eq=False)
class Tap:
    id: int
    condition: Condition
    listener: str
    watch: Any = None  # how it watches, if it is a monitor
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
    """What central did in one event. What the rules leave open is taken from here: the ids of what
    it made itself, and who of several with equal rights came first.
    """

    def __init__(self, effects: list[Effect]) -> None:
        self.facts = [
            fact for effect in effects if isinstance(effect, Record) for fact in effect.entry.facts
        ]
        self.told = [
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
            connection for connection, header in self.told if isinstance(header, headers.Deliver)
        ]
        next_slot = iter(slots)
        self.given = [
            (fact, next(next_slot) if isinstance(fact, facts.Delivered) else "")
            for fact in self.facts
            if is_turn(fact)
        ]
        refused = [
            (name, header) for name, header in self.told if isinstance(header, headers.Refused)
        ]
        self.deadlocked = [
            (name, header.number) for name, header in refused if header.refusal is Refusal.DEADLOCK
        ]

    def place(self, task: int) -> int:
        """The place of a task among those for which something was due."""
        return self.due.index(task) if task in self.due else len(self.due)

    @property
    def is_refused(self) -> bool:
        return any(
            isinstance(fact, facts.RequestRefused) and not is_deadlock(fact) for fact in self.facts
        )

    def is_accepted_as(self, number: int) -> bool:
        return any(
            isinstance(header, headers.Accepted) and header.id == number for _, header in self.told
        )

    def take_made(self, message: str, role: Role, parent: int, about: int, tap: int = 0) -> int:
        """The id of a message that central must have made, for a wiretap."""
        fired = [
            fact.listener
            for fact in self.facts
            if isinstance(fact, facts.TapFired) and fact.tap == tap
        ]
        for birth in self.made:
            is_it = (birth.message, birth.role, birth.parent, birth.about) == (
                message,
                role,
                parent,
                about,
            )
            if is_it and (birth.id in fired or not tap):
                self.made.remove(birth)
                return birth.id
        raise Disagreement(
            f"central made no {role} '{message}' under {parent} about {about}: {self.made}"
        )


def is_deadlock(fact: object) -> bool:
    """Whether central ends a wait here, takes a claim away or raises a failure because of a
    deadlock.
    """
    if isinstance(fact, facts.ClaimEnded):
        return fact.why.startswith(f"{Refusal.DEADLOCK}: ")
    if isinstance(fact, facts.Failed):
        return fact.failure == Refusal.DEADLOCK and fact.is_beside
    return isinstance(fact, facts.RequestRefused) and fact.refusal is Refusal.DEADLOCK


def is_lock_lost(fact: object) -> TypeGuard[facts.Failed]:
    """Whether central tells a task of the loss of what it kept locked."""
    return isinstance(fact, facts.Failed) and fact.failure == LOCK_LOST and fact.is_beside


def is_turn(fact: object) -> bool:
    """Whether somebody's turn has come, or has to come no more; or whether a task is told of what
    was taken.
    """
    return (
        isinstance(fact, facts.Delivered | facts.Granted) or is_deadlock(fact) or is_lock_lost(fact)
    )


class World:
    """Everything that the oracle knows."""

    def __init__(self) -> None:
        self.time = 0.0  # of the event
        self.due_by = 0.0  # what is due by then has happened
        self.step = self.round = self.turns = 0
        self.kinds: dict[str, MessageClass] = {}
        self.parts: dict[str, list[str]] = {}
        self.handlers: dict[str, list[Handler]] = {}  # newest last
        self.modules: dict[str, str] = {}  # by connection
        self.slots: dict[str, tuple[str, str]] = {}  # by connection, its resource: (module, name)
        self.root = Node(0, "root", MessageClass.GOAL, past=set(STARTS))
        self.nodes: dict[int, Node] = {}  # tasks that have not ended, oldest first
        self.jobs: list[Job] = []  # what is no task
        self.gone: Counter[str] = Counter()  # how often a module of that name has gone
        self.last: dict[Family, Node] = {}  # what flags refer to
        self.pairs: list[Pair] = []
        self.alarms: list[Alarm] = []
        self.endings: list[Ending] = []
        self.attached: dict[str, list[Attachment]] = {}  # by message, newest last
        self.taps: dict[str, list[Tap]] = {}  # by message
        self.waits: dict[tuple[str, int], tuple[Node, Moment]] = {}
        self.collectors: list[Collector] = []
        self.claims: list[Claim] = []  # oldest first
        self.ended: set[int] = set()
        self.came_to_nothing: set[int] = set()  # of these, the killed ones
        self.never_began: set[tuple[int, Moment]] = (
            set()
        )  # the starts that tasks had not reached when they were killed
        self.spared: set[Node] = (
            set()
        )  # exception handlers that nobody handles, and that wait all the same
        self.news = False  # a wiretap has sent something
        self.seen = Seen([])

    def node(self, task: int) -> Node | None:
        return self.root if task == 0 else self.nodes.get(task)

    def children(self, parent: Node) -> list[Node]:
        return [node for node in self.nodes.values() if node.parent is parent]

    def subtree(self, node: Node) -> list[Node]:
        """A task and all below it, parents before children."""
        found = [node]
        for each in found:  # grows while it is walked
            found += self.children(each)
        return found

    def everything(self) -> list[Job]:
        return [*self.nodes.values(), *self.jobs]
