"""The contents of ``tca top`` at a moment: rates from two answers of central. Pure; knows no
screen.
"""

from typing import Any

from msgspec import Struct, convert

from tca_wire.text.measures import listed, numbered, size
from tca_wire.text.waits_in_words import several_in_words, waiter_in_words
from tca_wire.waits import Waiter

Answer = dict[str, Any]
"""Central's answer on its load."""


class ResourceLine(Struct, frozen=True):
    """A resource; rates are of the time between two answers."""

    module: str
    resource: str
    capacity: int
    busy: float
    """Which part of its time it handled messages: 1 is all of it, in all slots."""
    rate: float
    """Messages a second."""
    handling: str
    seconds: float
    """How long the oldest of those has been handled."""
    blocked: int
    """How many of its slots wait for somebody else."""
    waiting: int
    oldest: float
    """Seconds that the oldest of those has waited."""
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
    """How many wait because nobody handles it."""


class WaitLine(Struct, frozen=True):
    """Somebody waits."""

    seconds: float
    what: str
    why: str
    by: str = ""
    """The module that suspended it."""


class Frame(Struct, frozen=True):
    """All that is shown at once."""

    epoch: str
    time: float
    """Central's clock, in seconds since it began."""
    span: float
    """Seconds over which rates were taken."""
    events: float
    """Of central, a second."""
    tasks: int
    modules: int
    resources: list[ResourceLine]
    """Those that somebody waits for or has for himself, and the busiest, come first."""
    messages: list[MessageLine]
    """Those that were sent most often lately come first."""
    waits: list[WaitLine]
    """The longest come first."""
    held: list[WaitLine]
    """Tasks that constraints, or a suspended parent, keep from beginning or ending; monitors that
    their parent waits for, the longest first.
    """
    suspended: list[WaitLine]
    """Tasks that somebody has to resume, the longest first; not those under them."""
    totals: dict[str, int]
    """How many waits, held and suspended tasks there are; central does not tell all."""
    not_looked_at: int
    """How many living tasks, the newest, may be held and were not counted."""
    memory: str
    """What fills central's memory."""
    is_cut: bool
    """Whether there is more than is told."""


def frame(now: Answer, before: Answer | None = None, hidden: str = "") -> Frame:
    """The contents for an answer. Rates are those since the answer *before*, or of the whole run;
    *hidden* is a module to leave out.
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
    """What central's memory holds, its fullest part, and how much was refused because a part was
    full.
    """
    parts: dict[str, tuple[int, int]] = now["memory"]
    fullest = max(parts, key=lambda part: parts[part][0] / max(parts[part][1], 1))
    held, most = parts[fullest]
    text = f"memory {size(sum(held for held, _ in parts.values()))}"
    text += f", {fullest} {size(held)} of {size(most)}" if held >= most / 10 else ""
    return text + (
        f", {now['overloads']:,} refused or dropped for want of it" if now["overloads"] else ""
    )


def _resource(
    module: str, now: dict[str, Any], before: dict[str, Any], span: float
) -> ResourceLine:
    if before.get("delivered", 0) > now["delivered"]:
        before = {}  # a module that was started anew counts from 0 again
    handling = now["handling"]
    what = listed([_called(one) for one in handling])
    busy = (now["busy"] - before.get("busy", 0.0)) / (span * max(now["capacity"], 1))
    rate = (now["delivered"] - before.get("delivered", 0)) / span
    held = (
        f"{'reserved' if now['is_reserved'] else 'locked'} by {now['held_by']}"
        if now["held_by"]
        else ""
    )
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


def _called(handled: dict[str, Any]) -> str:
    """``grasp {7} (cancel requested)``."""
    state = handled.get("state")
    return numbered(handled["message"], handled["id"]) + (f" ({state})" if state else "")


def _message(now: dict[str, Any], before: int, span: float) -> MessageLine:
    rate = max(now["delivered"] - before, 0) / span
    counts = now["delivered"], now["failed"], now["dropped"], now["waiting"]
    return MessageLine(now["message"], now["class"], rate, *counts)
