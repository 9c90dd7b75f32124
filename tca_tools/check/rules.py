"""The rules that every run keeps, in words, with their sources. Other files check them."""

from typing import NamedTuple

PAPER = "R. Simmons, Structured control for autonomous robots (1994)"
MANUAL = "TCA 8.5 manual"


class Rule(NamedTuple):
    """A rule that every run keeps."""

    text: str
    source: str

    def __str__(self) -> str:
        return self.text


class Violation(NamedTuple):
    """A rule or property that the journal breaks."""

    rule: str
    source: str
    place: int
    """The number of events before the one that breaks it."""
    event: int
    """The number of that event's entry; events that change nothing have a number but no entry."""
    time: float
    message: int
    """The message that it is about (0: none)."""
    what: str


# --- the journal ----------------------------------------------------------------------------------

CLOCK = Rule(
    "time and the numbers of entries never go back", "facts.Entry: a clock that never jumps"
)
NUMBERS = Rule(
    "a message is received once, and has a number above all before it",
    "facts.py: ids from one counter",
)
KNOWN = Rule(
    "nothing happens to a message that was never sent", f"{PAPER}, schema TaskTree: received"
)
ENDED = Rule("nothing happens to a task that has ended", f"{PAPER}, schema TaskTree: finished")
PRESENT = Rule(
    "a module joins once, before it does anything, and leaves nothing behind", f"{MANUAL}, modules"
)

# --- the task tree --------------------------------------------------------------------------------

PARENT = Rule(
    "a task has one parent: the root, or a task that has not ended",
    f"{PAPER}, schema TaskTree: parent",
)
PLAIN = Rule(
    "queries and informs hang under the root, without constraints",
    f"{PAPER}, schemas TaskTree and Node",
)
ONCE = Rule("a moment is reached once", f"{MANUAL}, temporal constraints")
ORDER = Rule(
    "the moments of a task come in their order", f"{MANUAL}, temporal constraints; TCM 2.10, nodes"
)
COMMAND = Rule(
    "a command is handled when it may be achieved, and a goal when it may be planned",
    f"{PAPER}, schema Node: achievConst = onHoldUntil",
)
FAMILY = Rule(
    "a task starts after its parent and ends after its children",
    f"{PAPER}, schema TaskTree: achievConst of the parent",
)
CONSTRAINT = Rule(
    "no moment is reached before the points that its constraints put before it",
    f"{MANUAL}, temporal constraints",
)
DELAY = Rule("a delay ends on time, not earlier", "TCM 2.10: DelayFor, DelayForAfter")
SETTLED = Rule(
    "everything that may happen happens at once",
    "TCM 2.10: the agenda is drained before anything else is done",
)
KILLED = Rule(
    "a killed task does not start, and its descendants are killed with it",
    f"{MANUAL}, killing task trees",
)
SUSPENDED = Rule("no task starts while it is suspended", "TCM 2.10: Suspend")

LIFE = Rule(
    "a task's state follows its life cycle, and its changes are numbered consecutively",
    "Lütkebohle et al., The Task-State Pattern, 4.4 and 4.5",
)
RESTARTED = Rule(
    "after a restart no task starts until all modules are back or lost, or the user says so",
    "docs/reliability.md",
)

# --- handlers and resources -----------------------------------------------------------------------

ONE_HANDLER = Rule(
    "a message is with one handler at a time", f"{PAPER}, schema TaskTree: node.handler"
)
RETURNED = Rule(
    "a handler that was given a message returns once", f"{MANUAL}, replies and responses"
)
HANDLES = Rule(
    "a message goes to a module that handles it, in the resource of its handler",
    f"{MANUAL}, handlers",
)
CAPACITY = Rule("a resource is never over its capacity", f"{MANUAL}, resources: capacity")
FREE = Rule("no message waits for a free resource", f"{MANUAL}, resources: pending messages")
LOCKED = Rule(
    "no message enters a resource that another module has locked or reserved",
    f"{MANUAL}, resources: locks and reservations",
)
GRANTED = Rule(
    "a lock or reservation is granted once, when the resource is empty",
    f"{MANUAL}, resources: locks",
)
QUEUED = Rule(
    "a message waits in one queue until it leaves it", f"{MANUAL}, resources: pending messages"
)
ANSWERED = Rule("a query is answered once, as soon as there is an answer", f"{MANUAL}, queries")
WAITS = Rule(
    "a wait for a moment ends when the moment is reached", f"{MANUAL}, waiting for commands"
)

# --- failures, wiretaps, monitors -----------------------------------------------------------------

CAUGHT = Rule(
    "a failure goes to the nearest exception handler, or ends the top-level task",
    f"{PAPER}, exception handling",
)
HANDLER = Rule(
    "an exception handler is called where it is attached, as often as it may be",
    f"{MANUAL}, exception handlers",
)
RECOVERED = Rule(
    "a failed task continues when its exception handler has dealt with the failure",
    "TCM 2.10: exceptions, DoneHandling",
)
MISSION = Rule(
    "a task of a mission that did not complete has failed or was killed", "docs/missions.md"
)
RESOLVED = Rule("no failure that was only observed counts as dealt with", "decision 101")
TAPPED = Rule(
    "a wiretap sends its listener before the tapped task continues", f"{MANUAL}, wiretaps"
)
MONITOR = Rule("a monitor watches from its start to its end", f"{MANUAL}, monitors")
KEPT = Rule(
    "a monitor that is not waited for ends when its parent waits for nothing else", "decision 42"
)

RULES = [rule for rule in globals().values() if isinstance(rule, Rule)]
