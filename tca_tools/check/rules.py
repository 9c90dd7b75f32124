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
    """The number of events before the event that breaks the rule or property."""
    event: int
    """The number of that event's entry; events that change nothing have a number but no entry."""
    time: float
    message: int
    """The message that it is about (0: none)."""
    what: str


def _from_paper(text: str, part: str) -> Rule:
    return Rule(text, f"{PAPER}, {part}")


def _from_manual(text: str, part: str) -> Rule:
    return Rule(text, f"{MANUAL}, {part}")


# --- the journal ----------------------------------------------------------------------------------

CLOCK = Rule(
    "time and the numbers of entries never go back", "facts.Entry: a clock that never jumps"
)
NUMBERS = Rule(
    "a message is received once, and has a number above all before it",
    "facts.py: ids from one counter",
)
KNOWN = _from_paper("nothing happens to a message that was never sent", "schema TaskTree: received")
ENDED = _from_paper("nothing happens to a task that has ended", "schema TaskTree: finished")
PRESENT = _from_manual(
    "a module joins once, before it does anything, and leaves nothing behind", "modules"
)

# --- the task tree --------------------------------------------------------------------------------

PARENT = _from_paper(
    "a task has one parent: the root, or a task that has not ended", "schema TaskTree: parent"
)
PLAIN = _from_paper(
    "queries and informs hang under the root, without constraints", "schemas TaskTree and Node"
)
ONCE = _from_manual("a moment is reached once", "temporal constraints")
ORDER = _from_manual(
    "the moments of a task come in their order", "temporal constraints; TCM 2.10, nodes"
)
COMMAND = _from_paper(
    "a command is handled when it may be achieved, and a goal when it may be planned",
    "schema Node: achievConst = onHoldUntil",
)
FAMILY = _from_paper(
    "a task starts after its parent and ends after its children",
    "schema TaskTree: achievConst of the parent",
)
CONSTRAINT = _from_manual(
    "no moment is reached before the points that its constraints put before it",
    "temporal constraints",
)
DELAY = Rule("a delay ends on time, not earlier", "TCM 2.10: DelayFor, DelayForAfter")
SETTLED = Rule(
    "everything that may happen happens at once",
    "TCM 2.10: the agenda is drained before anything else is done",
)
KILLED = _from_manual(
    "a killed task does not start, and its descendants are killed with it", "killing task trees"
)
SUSPENDED = Rule("no task starts while it is suspended", "TCM 2.10: Suspend")

LIFE = Rule(
    "a task's state follows its life cycle, and its changes are numbered consecutively",
    "Lütkebohle et al., The Task-State Pattern, 4.4 and 4.5",
)
RESTARTED = Rule(
    "after a restart no task starts until all modules are back or lost, or the user says so",
    "docs/concepts/survival.md",
)

# --- handlers and resources -----------------------------------------------------------------------

ONE_HANDLER = _from_paper(
    "a message is with one handler at a time", "schema TaskTree: node.handler"
)
RETURNED = _from_manual("a handler that was given a message returns once", "replies and responses")
HANDLES = _from_manual(
    "a message goes to a module that handles it, in the resource of its handler", "handlers"
)
CAPACITY = _from_manual("a resource is never over its capacity", "resources: capacity")
FREE = _from_manual("no message waits for a free resource", "resources: pending messages")
LOCKED = _from_manual(
    "no message enters a resource that another module has locked or reserved",
    "resources: locks and reservations",
)
GRANTED = _from_manual(
    "a lock or reservation is granted once, when the resource is empty", "resources: locks"
)
QUEUED = _from_manual(
    "a message waits in one queue until it leaves it", "resources: pending messages"
)
ANSWERED = _from_manual("a query is answered once, as soon as there is an answer", "queries")
WAITS = _from_manual("a wait for a moment ends when the moment is reached", "waiting for commands")

# --- failures, wiretaps, monitors -----------------------------------------------------------------

CAUGHT = _from_paper(
    "a failure goes to the nearest exception handler, or ends the top-level task",
    "exception handling",
)
HANDLER = _from_manual(
    "an exception handler is called where it is attached, as often as it may be",
    "exception handlers",
)
REPLACED = Rule(
    "the fallback of a retry policy replaces its task, and nothing else does", "decision 115"
)
RECOVERED = Rule(
    "a failed task continues when its exception handler has dealt with the failure",
    "TCM 2.10: exceptions, DoneHandling",
)
MISSION = Rule(
    "a task of a mission that did not complete has failed or was killed",
    "docs/packages/missions.md",
)
RESOLVED = Rule("no failure that was only observed counts as dealt with", "decision 101")
TAPPED = _from_manual("a wiretap sends its listener before the tapped task continues", "wiretaps")
MONITOR = _from_manual("a monitor watches from its start to its end", "monitors")
KEPT = Rule(
    "a monitor that is not waited for ends when its parent waits for nothing else", "decision 42"
)

RULES = [rule for rule in globals().values() if isinstance(rule, Rule)]
