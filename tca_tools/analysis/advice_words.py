"""Advice: its topic, its bounds, and its words, which are templates filled with data."""

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
    """A change that would make the run shorter."""

    topic: Topic
    title: str
    text: str
    remedy: str
    saving: float
    """The largest possible saving, in seconds."""
    on_path: float
    """The part of the saving on the report's first critical path. Only it ends the run sooner."""
    times: int
    """The number of cases."""
    example: str
    """The longest case."""
    window: Span
    """The span of the example."""
    sooner: str = ""
    """The task that would end sooner; "" for the task that ended last."""


class Words(NamedTuple):
    """The words of advice on a topic: a title, the finding, and what to do."""

    topic: Topic
    title: str
    text: str
    remedy: str

    def filled(
        self, saving: float, on_path: float, number: int, example: str, window: Span, **known: str
    ) -> Advice:
        """Return the advice with the templates filled from *known*."""
        known["times"] = times(number)
        title, text, remedy = (one.format(**known) for one in self[1:])
        return Advice(self.topic, title, text, remedy, saving, on_path, number, example, window)


FAILED = Words(
    Topic.FAILURE,
    "Avoid '{failure}' of '{message}'",
    "'{message}' failed {times} on the {path}. Its work until then and the recovery took {seconds}",
    "find out why it fails, or notice it sooner",
)
OVERLAP = Words(
    Topic.OVERLAP,
    "Plan the next step while {acting} acts",
    "{acting} was idle {times} between {pair}, {seconds} in all. For {planning} of that, "
    "{planners} planned the next step",
    "{remedy}",
)
REPLY = Words(
    Topic.QUERY,
    "Waits for the reply to '{name}'",
    "The {path} waits {times} for the reply to '{name}', {seconds} in all",
    "send the query before slow work and fetch the reply later (query_send), publish the value as "
    "a variable, or answer faster",
)
IN_VAIN = Words(
    Topic.IN_VAIN,
    "Waits in vain for the reply to '{name}'",
    "The {path} waits {times} for a reply to '{name}' that does not arrive in time, {seconds} "
    "in all",
    "find out why it takes long, answer faster, or give up sooner (timeout=). Giving up does not "
    "end the handler: it occupies its resource until it returns",
)
QUEUE = Words(
    Topic.CAPACITY,
    "{name} is a bottleneck",
    "The {path} waits {times} in the queue for {name}, {seconds} in all.{busy} One more slot, or a "
    "second module in its pool, would save at most {most}{but}",
    "raise its capacity, share its messages in a pool, or divide its messages between two "
    "resources",
)
GROWING = Words(
    Topic.CAPACITY,
    QUEUE.title,
    "More messages arrive for {name} than it handles: {rate_in} arrive per second, {rate_out} are "
    "handled. From {start} to {end} its queue grew to {length}, most of them '{message}'. The last "
    "one would have to wait for {drain}, and later ones longer",
    "let it handle {needed} at a time instead of {capacity} (capacity=) if its handlers can run in "
    "parallel, let a second module share its messages in a pool, handle each faster, send fewer, "
    "or queue only the newest (pending=)",
)
LOCK = Words(
    Topic.LOCK,
    "{name} is locked while others wait",
    "The {path} waits {times} because {name} is locked or reserved, or a lock of it is pending, "
    "{seconds} in all",
    "acquire the lock later, release it sooner, or lock a smaller resource",
)
CLAIM = Words(
    Topic.LOCK,
    "{name} is busy when a module locks it",
    "The {path} waits {times} to lock or reserve {name} until its handlers return, {seconds} "
    "in all",
    "lock it when nothing is handled there, send it less before that, or lock a smaller resource",
)
DELAY = Words(
    Topic.DELAY,
    "Delays before '{name}'",
    "Constraints with a delay hold '{name}' back {times} on the {path}, {seconds} in all",
    "shorten the delay if possible",
)
NEVER_HANDLED = Words(
    Topic.HANDLER,
    "No module handles '{name}'",
    "'{name}' waited {times} for a module that handles it, {seconds} in all, and no module did",
    "start a module that handles it; if one is running, check whether it names the message "
    "differently",
)
NOT_HANDLED = Words(
    Topic.HANDLER,
    "No module handles '{name}' for a while",
    "'{name}' waited {times} for a module that handles it, {seconds} in all",
    "start that module before the modules that need it (requires=), or find out why it left",
)
SUSPENDED = Words(
    Topic.SUSPENDED,
    "'{name}' is suspended for a while",
    "'{name}' was suspended {times}; no part of it ran for {seconds} in all",
    "resume it sooner, or suspend only the tasks that must stop",
)
