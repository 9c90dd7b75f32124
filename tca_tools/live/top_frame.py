"""The contents of ``tca top`` at one time, with rates from two answers of central.

Pure: it does not depend on a screen.
"""

from typing import Any

from msgspec import Struct, convert

from tca_wire.text.measures import listed, numbered, size
from tca_wire.text.waits_in_words import several_in_words, waiter_in_words
from tca_wire.waits import Waiter

Answer = dict[str, Any]
"""Central's answer about its load."""


class ResourceLine(Struct, frozen=True):
    """A resource; its rates cover the time between two answers."""

    module: str
    resource: str
    capacity: int
    busy: float
    """The share of time in which its slots handled messages: 1 means all slots, all the time."""
    rate: float
    """Messages a second."""
    handling: str
    seconds: float
    """Seconds since the oldest running handler started."""
    blocked: int
    """The number of its slots whose handlers wait."""
    waiting: int
    oldest: float
    """Seconds that the oldest queued message has waited."""
    held: str
    """The holder of its lock."""


class MessageLine(Struct, frozen=True):
    """A message."""

    message: str
    message_class: str
    rate: float
    delivered: int
    failed: int
    dropped: int
    waiting: int
    """The number that wait because the message has no handler."""


class WaitLine(Struct, frozen=True):
    """A task, message, handler or module that waits."""

    seconds: float
    what: str
    why: str
    by: str = ""
    """The module that suspended it."""


class Frame(Struct, frozen=True):
    """Everything that is shown at once."""

    epoch: str
    time: float
    """Central's clock, in seconds since the start of the run."""
    span: float
    """Seconds that the rates cover."""
    events: float
    """Central's events per second."""
    tasks: int
    modules: int
    resources: list[ResourceLine]
    """First the resources with a queue or a lock holder, then the busiest."""
    messages: list[MessageLine]
    """Sorted by their rate, the highest first."""
    waits: list[WaitLine]
    """The longest first."""
    held: list[WaitLine]
    """Held tasks, the longest first.

    Constraints or a suspended parent keep them from starting or ending. Monitors that their parent
    waits for are among them.
    """
    suspended: list[WaitLine]
    """Tasks that must be resumed, the longest first; not their descendants."""
    totals: dict[str, int]
    """The numbers of waits, held and suspended tasks; central does not list all."""
    not_looked_at: int
    """The number of the newest living tasks, among which central did not search for held tasks."""
    memory: str
    """The use of central's memory, in words."""
    is_cut: bool
    """Whether central lists only a part."""


def frame(now: Answer, before: Answer | None = None, hidden: str = "") -> Frame:
    """Return the contents for an answer of central.

    Args:
        now: the answer.
        before: an earlier answer; the rates cover the time since. None: the whole run.
        hidden: a module to leave out.
    """
    if before is None or before["epoch"] != now["epoch"] or before["time"] >= now["time"]:
        before = {"time": 0.0, "events": 0, "modules": [], "messages": []}
    span = max(now["time"] - before["time"], 1e-9)
    modules = [module for module in now["modules"] if module["module"] != hidden]
    known = {
        (module["module"], one["resource"]): one
        for module in before["modules"]
        for one in module["resources"]
    }
    resources = [
        _resource(module["module"], one, known.get((module["module"], one["resource"]), {}), span)
        for module in modules
        for one in module["resources"]
        if one["capacity"] or one["delivered"]
    ]
    resources.sort(key=lambda line: -1.0 if line.waiting or line.held else -round(line.busy, 1))
    delivered = {one["message"]: one["delivered"] for one in before["messages"]}
    messages = [_message(one, delivered.get(one["message"], 0), span) for one in now["messages"]]
    messages.sort(key=lambda line: (-line.rate, -line.waiting, -line.delivered, line.message))
    waits, held = (
        [
            WaitLine(one.seconds, waiter_in_words(one), several_in_words(one.waits, now["time"]))
            for one in waiters
        ]
        for waiters in (convert(now[key], list[Waiter]) for key in ("waits", "held"))
    )
    suspended = [
        WaitLine(
            one.seconds, waiter_in_words(one), f"'tca resume {one.number}'", one.waits[0].module
        )
        for one in convert(now["suspended"], list[Waiter])
    ]
    events = (now["events"] - before["events"]) / span
    not_looked_at = now["tasks"] - now["looked_at"]
    is_cut = not_looked_at > 0 or any(
        total > len(now[kind]) for kind, total in now["totals"].items()
    )
    return Frame(
        now["epoch"],
        now["time"],
        span,
        events,
        now["tasks"],
        len(modules),
        resources,
        messages,
        waits,
        held,
        suspended,
        now["totals"],
        not_looked_at,
        memory_in_words(now),
        is_cut,
    )


def memory_in_words(now: Answer) -> str:
    """Return the size of central's memory, its fullest part, and the number of refusals for it."""
    parts: dict[str, tuple[int, int]] = now["memory"]
    fullest = max(parts, key=lambda part: parts[part][0] / max(parts[part][1], 1))
    held, most = parts[fullest]
    text = f"memory {size(sum(held for held, _ in parts.values()))}"
    text += f", {fullest} {size(held)} of {size(most)}" if held >= most / 10 else ""
    return text + (
        f", {now['overloads']:,} refused or dropped when it was full" if now["overloads"] else ""
    )


def _resource(
    module: str, now: dict[str, Any], before: dict[str, Any], span: float
) -> ResourceLine:
    if before.get("delivered", 0) > now["delivered"]:
        before = {}  # a restarted module counts from 0 again
    handling = now["handling"]
    what = listed([_task_in_words(one) for one in handling])
    busy = (now["busy"] - before.get("busy", 0.0)) / (span * max(now["capacity"], 1))
    rate = (now["delivered"] - before.get("delivered", 0)) / span
    held = "reserved" if now["is_reserved"] else "locked"
    held = f"{held} by {now['held_by']}" if now["held_by"] else ""
    seconds = max((one["seconds"] for one in handling), default=0.0)
    return ResourceLine(
        module,
        now["resource"],
        now["capacity"],
        min(max(busy, 0.0), 1.0),
        rate,
        what,
        seconds,
        now["blocked"],
        now["waiting"],
        now["oldest"],
        held,
    )


def _task_in_words(handled: dict[str, Any]) -> str:
    """``grasp {7} (cancel requested)``."""
    state = handled.get("state")
    return numbered(handled["message"], handled["id"]) + (f" ({state})" if state else "")


def _message(now: dict[str, Any], before: int, span: float) -> MessageLine:
    rate = max(now["delivered"] - before, 0) / span
    counts = now["delivered"], now["failed"], now["dropped"], now["waiting"]
    return MessageLine(now["message"], now["class"], rate, *counts)
