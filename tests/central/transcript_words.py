"""The words of transcripts. Some functions read points, options and exception handlers; others
describe facts and headers.
"""

import json
import re
from typing import Any, get_type_hints

import msgspec

from tca_wire.constraints import Constraint
from tca_wire.journal import facts
from tca_wire.journal.facts import kind_of
from tca_wire.messages.notices import NOTICES
from tca_wire.packets.parts import Attachment, StateChange, WatchOptions
from tca_wire.points import ROOT, THIS, Moment, Point, TaskId, describe_moments
from tca_wire.text.facts_in_words import fields_of, kill_reason
from tca_wire.text.waits_in_words import in_words, several_in_words, waiter_in_words
from tca_wire.vocabulary import CENTRAL


def read_point(text: str) -> Point:
    edge, interval, task = text.split()
    return Point(
        THIS if task == "this" else TaskId(int(task)), Moment[f"{edge}_{interval}".upper()]
    )


def read_fields(kind: type, text: str) -> dict[str, Any]:
    """Return the fields of a header or fact, read from a text such as ``task=3 why="enough"``."""
    hints = get_type_hints(kind)
    found = re.findall(r"(\w+)=(\".*?(?<!\\)\"|[\[{].*?[\]}](?= \w+=|$)|\S+)", text)
    return {name: read_field(name, json.loads(value), hints[name]) for name, value in found}


def read_field(name: str, value: Any, hint: Any) -> Any:
    if name == "moment" and isinstance(value, str):
        return Moment[value.upper().replace(" ", "_")]
    return msgspec.convert(value, hint, strict=False)


def read_watch(options: str) -> WatchOptions:
    found = dict(re.findall(r"(?<!fire )\b(every|duration|maximum) ([\d.]+)", options))
    fire_every = re.search(r"fire every (\d+)", options)
    until = re.search(r"until (\w+ \w+ \d+)", options)
    return WatchOptions(
        float(found.get("every", 0)),
        int(found.get("maximum", 0)),
        int(fire_every[1]) if fire_every else 1,
        "at first" in options,
        float(found.get("duration", 0)),
        read_point(until[1]) if until else None,
        "waited for" in options,
    )


def read_attachment(text: str) -> Attachment:
    failure, handler, maximum = re.fullmatch(r"\s*(.+)->(\w+)(?:\*(\d+))?\s*", text).groups()  # type: ignore[union-attr]
    return Attachment("" if failure == "any" else failure, handler, int(maximum or 0))


def constraints(text: str) -> tuple[Constraint, ...]:
    return tuple(constraint(part) for part in text.split(","))


def constraint(text: str) -> Constraint:
    before, after = (side.strip() for side in text.split("<="))
    before, _, delay = before.partition(" + ")
    if re.fullmatch(r"[\d.]+", before):
        return Constraint(Point(ROOT, Moment.START_ACHIEVING), read_point(after), float(before))
    return Constraint(read_point(before), read_point(after), float(delay or 0))


def describe(fact: facts.Fact) -> str:
    """Describe a fact in a line. Formats, resources and refusals get no line, because answers show
    them.
    """
    match fact:
        case facts.Received():
            under = f" under {fact.parent}" if fact.parent else ""
            held = "".join(f"\n  {constraint}" for constraint in fact.constraints)
            role = f" ({fact.role})" if fact.role else ""
            data = f": {msgspec.msgpack.decode(fact.body)}" if fact.message in NOTICES else ""
            what = f"{fact.message_class} {fact.message} as {fact.id}"
            return f"received {what} from {fact.sender}{under}{role}{data}{held}"
        case facts.Constrained():
            return "\n".join(f"constrained {constraint}" for constraint in fact.constraints)
        case facts.Reached():
            return f"{fact.task} reached {', '.join(describe_moments(fact.moments))}"
        case facts.Delivered():
            what = "" if fact.id == fact.message_id else f" (message {fact.message_id})"
            slot = f", slot {fact.slot}" if fact.slot > 1 else ""
            nested = ", within its wait" if fact.is_nested else ""
            return f"{fact.id}{what} delivered to {fact.module}{slot}{nested}{described_priority(fact)}"
        case facts.Queued():
            return f"{fact.id} waits for {fact.module or 'a handler'}{described_priority(fact)}"
        case facts.Dropped():
            return f"dropped: {fact.message} {fact.id}{described_copy(fact)}: {fact.why}{fact.where and f': {fact.where}'}"
        case facts.Failed():
            whose = f" by {fact.by}" if fact.by not in ("", CENTRAL) else ""
            beside = f", beside its handler{whose}" if fact.is_beside else ""
            return f"failed: id {fact.id}{described_copy(fact)}, failure {fact.failure}, text {fact.text}{beside}"
        case facts.FormatDefined() | facts.ResourceChanged() | facts.RequestRefused():
            return ""
        case facts.ModuleJoined():
            return f"module {fact.module} joined"
        case facts.HandlerAdded() | facts.HandlerRemoved():
            return f"module {fact.module} {'handles' if kind_of(fact) == 'handler' else 'no longer handles'} {fact.message}"
        case facts.Returned():
            return f"handler of {fact.id} returned: {fact.outcome}"
        case _:
            return describe_control(fact)


def described_priority(fact: facts.Queued | facts.Delivered) -> str:
    return f", priority {fact.priority}" if fact.priority else ""


def described_copy(fact: facts.Failed | facts.Dropped) -> str:
    return f" (a copy of {fact.copy_of})" if fact.copy_of else ""


def describe_control(fact: facts.Fact) -> str:
    """Describe a fact about the control of tasks: recoveries, suspensions, wiretaps, monitors,
    attachments.
    """
    match fact:
        case facts.Caught():
            return f"{fact.handler} handles the failure of {fact.task}, attached to {fact.at}"
        case facts.SuspendedOrResumed():
            return f"{fact.task} {'suspended' if fact.is_suspended else 'resumed'} by {fact.by}"
        case (
            facts.Killed()
            | facts.Retried()
            | facts.KillPlanned()
            | facts.DeadlineSet()
            | facts.SendPlanned()
        ):
            return describe_ending(fact)
        case facts.TimedOut():
            return f"time is up for {fact.constraint}"
        case facts.Unhandled() | facts.Recovered():
            undecided = getattr(fact, "undecided", 0)
            return f"{fact.task} {kind_of(fact)}" + (
                f": {undecided} could not decide" if undecided else ""
            )
        case facts.TapAdded():
            return f"{fact.id} taps {fact.message}{f' {fact.task}' if fact.task else ''}, {fact.condition}: {fact.listener}"
        case facts.TapFired():
            return f"tap {fact.tap} for {fact.tapped}: {fact.listener or 'nobody listens'}"
        case facts.MonitorTested():
            return f"condition of {fact.monitor} {'holds' if fact.holds else 'does not hold'}"
        case facts.MonitorEnded():
            return f"{fact.monitor} watches no longer: {fact.why}"
        case facts.Claimed() | facts.Granted() | facts.ClaimEnded():
            return describe_claim(fact)
        case facts.Attached():
            place = fact.message or f"task {fact.task}"
            return (
                f"{fact.id} attached: {fact.handler} for {fact.failure or 'any failure'} of {place}"
            )
        case _:
            return describe_rest(fact)


def describe_rest(fact: facts.Fact) -> str:
    """Describe a change of state, or the fields of any other fact."""
    if isinstance(fact, facts.StateChanged):
        by = f"{fact.by} {fact.module}".rstrip()
        return f"{fact.task} {fact.transition} by {by}: {fact.state}, change {fact.serial}{_why(fact.text, fact.body)}"
    return f"{kind_of(fact)}: " + ", ".join(
        f"{key} {value}" for key, value in fields_of(fact).items()
    )


def describe_ending(
    fact: facts.Killed | facts.Retried | facts.KillPlanned | facts.DeadlineSet | facts.SendPlanned,
) -> str:
    match fact:
        case facts.SendPlanned():
            return f"{fact.message} is to be sent when {fact.task} is killed"
        case facts.Retried():
            failed = f", after the failure of {fact.failed}" if fact.failed else ""
            pause = f", held by {fact.pause}" if fact.pause else ""
            fallback = f", to be replaced by {fact.fallback}" if fact.fallback else ""
            return f"{fact.task} retried by {fact.by}{failed}{pause}{fallback}"
        case facts.DeadlineSet():
            return f"{fact.task} has {fact.seconds:g} s until {describe_moments(fact.moment)[0]}"
        case facts.KillPlanned():
            after = f", after {fact.after}" if fact.after else ""
            return f"{fact.task} is to be killed ({fact.scope}){after}, in {fact.seconds:g} s"
        case facts.Killed():
            return f"killed: task {fact.task}, {kill_reason(fact.why, fact.by)}"


def describe_claim(fact: facts.Claimed | facts.Granted | facts.ClaimEnded) -> str:
    match fact:
        case facts.Claimed():
            kind = "reserve" if fact.is_reserved else "lock"
            return f"{fact.id} wants to {kind} {fact.resource} of {fact.module}, from {fact.sender}"
        case facts.Granted():
            return f"{fact.id} granted"
        case facts.ClaimEnded():
            return f"{fact.id} ended: {fact.why}"


def _why(text: str, body: bytes) -> str:
    """Return the reason for a change of state, and the data of the change."""
    data = f", data {msgspec.msgpack.decode(body)}" if body else ""
    return (f", {text}" if text else "") + data


def describe_observed(header: Any, body: bytes) -> str:
    """Describe an answer to an observer."""
    if not body:
        return "observes" if header.more else "observes no longer"
    assert header.more, "the end of an observation has no body"
    change = msgspec.msgpack.decode(body, type=StateChange)
    whose = f" by {change.by} {change.module}".rstrip() if change.transition else ""
    what = f"{change.transition}{whose}, " if change.transition else ""
    goal = f", goal {msgspec.msgpack.decode(change.goal)}" if change.goal else ""
    late = ", late" if change.is_late else ""
    over = ", over" if change.is_over else ""
    return f"sees {change.task} {change.message}: {what}{change.state}, change {change.serial}{_why(change.text, change.data)}{goal}{late}{over}"


def describe_inspected(row: dict[str, Any]) -> str:
    """Describe an inspected task in a line."""
    data, result = (
        msgspec.msgpack.decode(row[key]) if row[key] else None for key in ("data", "result")
    )
    end = f", {row['outcome']}" if row["outcome"] else ", lives"
    failure = f" with {row['failure']}" if row["failure"] else ""
    return f"{row['task']} {row['message']} under {row['parent']}, data {data}{end}{failure}{f': {result}' if result else ''}"


def describe_answer(answer: Any) -> str:
    """Describe a header, or the value of a variable, in a line."""
    return f"value {answer}" if isinstance(answer, str) else describe_header(answer)


def describe_header(header: Any) -> str:
    fields = {
        name: getattr(header, name)
        for name in header.__struct_fields__
        if name not in ("number", "version")
    }
    words = ", ".join(
        f"{key} {value}" for key, value in fields.items() if value not in ("", False, 0)
    )
    return f"{type(header).__name__.lower()} {words}".strip()


def load_lines(load: dict[str, Any]) -> list[str]:
    """Return a line for each resource and message with activity, and for each wait."""
    lines = []
    for module in load["modules"]:
        for one in module["resources"]:
            known = {
                name: value
                for name, value in one.items()
                if value and name not in ("resource", "capacity")
            }
            if handling := known.pop("handling", []):
                known["handling"] = " and ".join(
                    f"{run['message']} {{{run['id']}}} for {run['seconds']:g} s" for run in handling
                )
            lines += (
                [f"resource {one['resource']} of {module['module']}: {listed(known)}"]
                if known
                else []
            )
    for one in load["messages"]:
        known = {
            name: one[name] for name in ("delivered", "failed", "dropped", "waiting") if one[name]
        }
        lines += [f"message {one['message']}: {listed(known)}"] if known else []
    for kind in ("waits", "held", "suspended", "killed"):
        for one in load[kind]:
            end = f"; in the end {in_words(one.end)}" if one.end else ""
            why = f" (killed: {one.killed})" if one.killed else ""
            lines.append(
                f"{kind}: {waiter_in_words(one)}{why} {several_in_words(one.waits)}, {one.seconds:g} s{end}"
            )
    lines += [f"{one.tasks} wait in the end {in_words(one.wait)}" for one in load["ends"]]
    return [*lines, f"totals: {listed(load['totals'])}"]


def listed(known: dict[str, Any]) -> str:
    return ", ".join(f"{name} {value}" for name, value in known.items())
