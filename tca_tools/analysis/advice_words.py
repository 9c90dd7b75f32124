"""A piece of advice: its topic, its bounds, and its words, which are templates filled with data."""

from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

from tca_tools.spans import Span
from tca_wire.text.measures import times


class Topic(StrEnum):
    """The topic of a piece of advice."""

    FAILURE = "failures"
    OVERLAP = "plan while acting"
    QUERY = "ask sooner"
    IN_VAIN = "asked in vain"
    CAPACITY = "more capacity"
    LOCK = "shorter locks"
    HANDLER = "missing handler"
    SUSPENDED = "suspended"
    DELAY = "delays"


@dataclass(slots=True)
class Advice:
    """Something that would make the run shorter."""

    topic: Topic
    title: str
    text: str
    remedy: str
    saving: float
    """At most so many seconds."""
    on_path: float
    """How many of them lie on the critical path that the report shows first: only these make the
    end come sooner.
    """
    times: int
    """How often it happened."""
    example: str
    """The longest case."""
    window: Span
    """When the example happened."""
    sooner: str = ""
    """The task whose end would come sooner, if it is another than that which ended last."""


class Words(NamedTuple):
    """The words of advice on a topic: a title, the finding, and what to do."""

    topic: Topic
    title: str
    text: str
    remedy: str

    def filled(
        self, saving: float, on_path: float, number: int, example: str, window: Span, **known: str
    ) -> Advice:
        """The advice that these words make of what is *known*."""
        known["times"] = times(number)
        title, text, remedy = (one.format(**known) for one in self[1:])
        return Advice(self.topic, title, text, remedy, saving, on_path, number, example, window)


FAILED = Words(
    Topic.FAILURE,
    "Avoid '{failure}' of '{message}'",
    "'{message}' failed {times} on the {path}. What it had done until then and what was done about it took {seconds}",
    "find out why it fails, or notice it sooner",
)
OVERLAP = Words(
    Topic.OVERLAP,
    "Plan the next while {acting} acts",
    "{acting} stood idle {times} between {pair}, {seconds} in all. For {planning} of that {planners} planned what "
    "comes next",
    "{remedy}",
)
REPLY = Words(
    Topic.QUERY,
    "The reply to '{name}' is waited for",
    "The {path} waits {times} for the reply to '{name}', {seconds} in all",
    "ask before something slow and fetch the reply later (query_send), keep the value as a variable, or answer faster",
)
IN_VAIN = Words(
    Topic.IN_VAIN,
    "The reply to '{name}' is waited for in vain",
    "The {path} waits {times} for a reply to '{name}' that does not come in time, {seconds} in all",
    "find out why it takes so long, answer faster, or give up sooner (timeout=). Giving up does not end the handler: "
    "it keeps its resource from all others until it returns",
)
QUEUE = Words(
    Topic.CAPACITY,
    "{name} is a bottleneck",
    "The {path} stands {times} in the queue for {name}, {seconds} in all.{busy} One more slot, or a second module in "
    "its pool, would save at most {most}{but}",
    "raise its capacity, share its messages in a pool, or split what it handles over two resources",
)
GROWING = Words(
    Topic.CAPACITY,
    QUEUE.title,
    "More messages come for {name} than it handles: {rate_in} a second come, {rate_out} are handled. From {start} to "
    "{end} its queue grew to {length}, most of them '{message}'. The last one would have to wait for {drain}, and "
    "later ones longer",
    "let it handle {needed} at a time instead of {capacity} (capacity=), if its handlers do not get in each other's "
    "way, let a second module share its messages in a pool, handle each faster, send fewer, or let only the newest "
    "wait (pending=)",
)
LOCK = Words(
    Topic.LOCK,
    "{name} is locked while others wait",
    "The {path} waits {times} because {name} is locked or reserved, or somebody waits to lock it, {seconds} in all",
    "take the lock later, release it sooner, or lock a smaller resource",
)
CLAIM = Words(
    Topic.LOCK,
    "{name} is busy when it is to be locked",
    "The {path} waits {times} to lock or reserve {name} until its handlers are done, {seconds} in all",
    "lock it when nothing is handled there, send it less before, or lock a smaller resource",
)
DELAY = Words(
    Topic.DELAY,
    "Delays before '{name}'",
    "Constraints with a delay hold '{name}' back {times} on the {path}, {seconds} in all",
    "shorten the delay, if what it waits for allows that",
)
NEVER_HANDLED = Words(
    Topic.HANDLER,
    "Nobody handles '{name}'",
    "'{name}' waited {times} for a module that handles it, {seconds} in all, and none ever came",
    "start a module that handles it; if there is one, see whether it calls the message something else",
)
NOT_HANDLED = Words(
    Topic.HANDLER,
    "Nobody handles '{name}' for a while",
    "'{name}' waited {times} for a module that handles it, {seconds} in all",
    "start that module before what needs it (requires=), or find out why it left",
)
SUSPENDED = Words(
    Topic.SUSPENDED,
    "'{name}' is suspended for a while",
    "'{name}' was suspended {times}; it stood still for {seconds} in all, not counting what ran on under it",
    "resume it sooner, or suspend only what has to stand",
)
