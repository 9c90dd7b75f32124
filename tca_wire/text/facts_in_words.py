"""The facts of a journal in words, one line each. The only state is the names of messages."""

import re
from collections.abc import Callable
from datetime import UTC, datetime
from functools import cache
from typing import Any

from tca_wire.constraints import Constraint
from tca_wire.journal import facts
from tca_wire.journal.causes import Administrator, Cause, ConnectionLost, TimeOver
from tca_wire.messages.notices import COMMANDS
from tca_wire.points import ROOT, Point, describe_moments
from tca_wire.text.measures import duration
from tca_wire.vocabulary import CENTRAL, Due, Scope
from tca_wire.waits import WaitKind


class Wording:
    """Facts in words.

    It remembers each message's name for later facts; *known* returns the names of earlier messages.
    """

    def __init__(self, known: Callable[[int], str] = lambda _: "?") -> None:
        self._names: dict[int, str] = {}
        self._known = known

    def words(self, fact: facts.Fact) -> str:
        """Return a fact in words, without its kind and body."""
        if isinstance(fact, facts.Received):
            self._names[fact.id] = fact.message
        elif isinstance(fact, facts.Delivered | facts.Queued):
            self._names.setdefault(
                fact.id, self._names.get(fact.message_id) or self._known(fact.message_id)
            )
        elif isinstance(fact, facts.Claimed):
            kind = "reservation" if fact.is_reserved else "lock"
            self._names[fact.id] = f"{kind} of {place(fact.module, fact.resource)}"
        phrase = PHRASES.get(type(fact)) or f"{{{fact.__struct_fields__[0]}:name}}"
        return self.filled(phrase, fact)

    def filled(self, phrase: str, source: Any) -> str:
        """Fill a phrase with the fields of a fact or attachment; ``PHRASES`` explains its parts."""
        return "".join(self._part(source, *part) for part in _parts(phrase))

    def _part(self, source: Any, flag: str, optional: str, required: str) -> str:
        """Fill a part of a phrase; return "" for an optional part without values."""
        if flag:
            optional = optional.partition("|")[0 if getattr(source, flag) else 2]
        words, *fields = _pieces(optional or required)
        for name, form, following in zip(fields[::3], fields[1::3], fields[2::3], strict=True):
            value = getattr(source, name)
            if not (value or flag or required):
                return ""
            words += _FORMS[form](self, source, value) + following
        return words

    def cause(self, cause: Cause) -> str:
        """Return the cause of an entry: ``Kill by user, in the handler of walk {1}``."""
        if isinstance(cause, TimeOver):
            return _DUE[cause.due] + (f" of {self.name(cause.about)}" if cause.about else "")
        if isinstance(cause, ConnectionLost):
            return f"a connection of {cause.module} was lost"
        if isinstance(cause, Administrator):
            return "the operator of central"
        handler = f", in the handler of {self.name(cause.origin)}" if cause.origin else ""
        return f"{cause.message or 'an invalid request'}{by_whom(cause.module)}{handler}"

    def name(self, number: int) -> str:
        """Return a message, task or lock: ``walk {1}``."""
        return f"{self._names.get(number) or self._known(number)} {{{number}}}"

    def point(self, point: Point) -> str:
        """Return a point: ``end handling of walk {1}``."""
        return f"{_moments(point.moment)} of {self.name(point.task)}"

    def constraint(self, constraint: Constraint) -> str:
        """Return ``end handling of walk {1} + 2 s before start handling of grip {2}``.

        A constraint on time alone is ``2 s before start handling of grip {2}``.
        """
        parts = [] if constraint.before.task == ROOT else [self.point(constraint.before)]
        if constraint.delay or not parts:
            parts.append(_seconds(constraint.delay) if constraint.delay else "")
        return f"{' + '.join(parts)} before {self.point(constraint.after)}"


ATTACHMENT = "{handler} for [failure?{failure}|any failure][ (at most {maximum} times)]"

PHRASES: dict[type, str] = {
    facts.Opened: "segment {segment} of {epoch}, by central {central}; time 0 is {began:date}",
    facts.Closed: "{why}",
    facts.CentralFailed: "{why}",
    facts.CentralRestarted: (
        "down for {away:seconds}; waiting for {awaited} connections; no task starts until "
        "[hold?a module allows it|all are back or lost]"
        "[may_lack?; the last inputs may be missing, {aside} entries were set aside]"
    ),
    facts.Shortened: "removed all that had ended by {until:seconds} ('tca log prune')",
    facts.DiskSpace: "the disk of the journal [is_low?is nearly full|has room again]",
    facts.MembersChanged: (
        "{leader} leads[standbys?; {standbys:list} can take over][behind?; behind: {behind:list}]"
    ),
    facts.CentralEnding: "ends{by:by}; the run [keep?continues at the next start|is over]",
    facts.WentOn: "tasks start again{by:by}",
    facts.ModuleJoined: "{module}[, {process}][, {principal}]",
    facts.KeysChanged: "[allowed: {allowed:list} ][revoked: {revoked:list}]",
    facts.ModuleLeft: "{module}: {why}",
    facts.PermissionsChanged: (
        "[source?{rules} rules of {source}|no rules: every module may do everything]"
    ),
    facts.ResourceChanged: "{module:place} handles up to {capacity} at a time",
    facts.Recalling: (
        "{module:place} [is_over?has answered|is asked] which prefetched messages have not started"
    ),
    facts.FormatDefined: "{message_class} {message}, declared by {module}",
    facts.HandlerAdded: "{module:place} handles {message}",
    facts.HandlerRemoved: "{module} no longer handles {message}",
    facts.RequestRefused: "{sender}: {refusal}: {text}",
    facts.Ignored: "{sender}: {text}",
    facts.Received: (
        "{message_class} {id:name} from {sender}[ under {parent:name}][parent?|{origin:in}]"
        "[blocking?, which waits][, {role} for {about:name}][; {constraints:constraints}]"
    ),
    facts.Queued: "{message_id:name} for [module?{module:place}|a handler][, priority {priority}]",
    facts.Delivered: (
        "{id:name}{message_id:original} to {module:place}{slot:slot}"
        "[is_nested?, while another message waits there][, priority {priority}]"
    ),
    facts.Postponed: "{id:name} is replied to later[frees_slot?, and its slot is free]",
    facts.Returned: "{id:name}: {outcome}",
    facts.Dropped: "{message} {id:number}[ of message {copy_of:number}]: {why}[: {where}]",
    facts.Constrained: "{constraints:constraints}",
    facts.TimedOut: "{constraint:constraint}",
    facts.Reached: "{task:name}: {moments:moments}",
    facts.Killed: "{task:name}: {why:reason}",
    facts.KillPlanned: (
        "{scope:scope}{task:name}[ in {seconds:seconds}][ after {after:point}]: {why:reason}"
    ),
    facts.SendPlanned: "{message} when {task:name} is killed",
    facts.DeadlineSet: "{task:name}: {moment:moments} within {seconds:seconds}",
    facts.SuspendedOrResumed: "{task:name}[is_suspended?| is resumed]{by:by}",
    facts.StateChanged: "{task:name}: {transition}{module:by}[, now {state}][: {text}]",
    facts.Kept: "{task:name} by {module}",
    facts.Released: "{task:name}[module? by {module}|: its record was removed]",
    facts.Awaited: "the answer to {id:name}",
    facts.WaitBegan: "{module}{origin:in} for {task:awaited}",
    facts.WaitEnded: "{module}{origin:in} for {task:awaited}",
    facts.Claimed: "{id:name} by {sender}{origin:in}",
    facts.ClaimEnded: "{id:name}: {why}",
    facts.Failed: "{id:name}[ of message {copy_of:number}]: {failure}[: {text}]{by:raised}",
    facts.Attached: "{id:number} " + ATTACHMENT + " of [message?all {message}|{task:at}]",
    facts.Removed: "{id:number}{by:by}",
    facts.Caught: "{task:name} by {handler:name}, attached to {at:at}",
    facts.NotResolved: "{handler:name} returned without dealing with the failure of {task:name}",
    facts.Unhandled: "{task:name}[, so {undecided:name} could not decide]",
    facts.Retried: (
        "{task:name}{by:by}[failed?, after the failure of {failed:name}]"
        "[fallback?, replaced by {fallback}]"
    ),
    facts.TapAdded: "{id:number} {listener} {condition} of [task?{task:name}|all {message}]{by:by}",
    facts.TapFired: (
        "{tap:number} for {tapped:name}: [listener?{listener:name}|the listener has no handler]"
    ),
    facts.MonitorTested: "{monitor:name}: [holds?holds|does not hold]",
    facts.MonitorEnded: "{monitor:name}: {why}",
}
"""The phrase of each kind of fact. Other facts show the task or message in their first field.

``{field:form}`` is a field in one of the forms below. A part in brackets is left out if one of its
fields is empty. In ``[field?this|that]`` the field selects the alternative.
"""

_PART = re.compile(r"\[(?:(\w+)\?)?([^]]*)\]|([^[]+)")
_FIELD = re.compile(r"\{(\w+):?(\w*)\}")


@cache
def _parts(phrase: str) -> list[tuple[str, str, str]]:
    """Return the parts of a phrase: the flag, then the text of an optional or a required part."""
    return _PART.findall(phrase)


@cache
def _pieces(text: str) -> list[str]:
    """Split a part at its fields: the text before, then each field's name, form and next text."""
    return _FIELD.split(text)


_AWAITED = {WaitKind.CHANGE: "a change of ", WaitKind.PRESENCE: "handlers of "}

_FORMS: dict[str, Callable[[Wording, Any, Any], str]] = {
    "": lambda _, __, value: str(value),
    "at": lambda wording, _, task: wording.name(task) if task else "the root",
    "attachment": lambda wording, _, one: wording.filled(ATTACHMENT, one),
    "attachments": lambda wording, _, several: " and ".join(
        wording.filled(ATTACHMENT, one) for one in several
    ),
    "awaited": lambda wording, fact, task: (
        _AWAITED.get(fact.awaits, "") + _moment_of(fact) + (fact.name or wording.name(task))
    ),
    "by": lambda _, __, by: by_whom(by),
    "constraint": lambda wording, _, one: wording.constraint(one),
    "constraints": lambda wording, _, several: "; ".join(map(wording.constraint, several)),
    "date": lambda _, __, seconds: _date(seconds),
    "duration": lambda _, __, seconds: duration(seconds),
    "in": lambda wording, _, origin: f" in {wording.name(origin)}" if origin else "",
    "list": lambda _, __, names: ", ".join(names),
    "moments": lambda _, __, moments: _moments(moments),
    "name": lambda wording, _, number: wording.name(number),
    "number": lambda _, __, number: f"{{{number}}}",
    "original": lambda _, fact, number: f" of message {{{number}}}" if number != fact.id else "",
    "place": lambda _, fact, module: place(module, fact.resource),
    "point": lambda wording, _, point: wording.point(point),
    "raised": lambda _, __, by: raised_by(by),
    "reason": lambda _, fact, why: kill_reason(why, fact.by),
    "scope": lambda _, __, scope: f"{scope} of " if scope is not Scope.TASK else "",
    "seconds": lambda _, __, seconds: _seconds(seconds),
    "slot": lambda _, __, slot: f", slot {slot}" if slot > 1 else "",
}
"""The forms of fields."""


def fields_of(fact: facts.Fact) -> dict[str, object]:
    """Return a fact as a dictionary for text forms: moments as words, bodies left out."""
    fields = {name: getattr(fact, name) for name in fact.__struct_fields__ if name != "body"}
    if isinstance(fact, facts.Reached):
        fields["moments"] = describe_moments(fact.moments)
    elif isinstance(fact, facts.WaitBegan | facts.DeadlineSet):
        fields["moment"] = ", ".join(describe_moments(fact.moment))
    if isinstance(fact, facts.WaitBegan | facts.WaitEnded):
        # Show "awaits" and the other defaults only where they say something.
        fields = {name: value for name, value in fields.items() if value or name == "origin"}
        if fact.awaits is WaitKind.TASK:
            del fields["awaits"]
    return fields


def subject_of(fact: facts.Fact) -> int:
    """Return the message, task, lock or attachment that a fact is about; 0 for none."""
    fields = (
        getattr(fact, name, None)
        for name in ("task", "message_id", "id", "tapped", "monitor", "handler")
    )
    return next((number for number in fields if isinstance(number, int)), 0)


def called(module: str) -> str:
    """Return the name that a module chose: ``legs`` for ``legs#2``, the second of that name."""
    return module.partition("#")[0]


def by_whom(by: str) -> str:
    """Return the requester: " by legs", " by the command 'tca kill'"; "" for central itself."""
    if by.startswith(COMMANDS):
        return f" by the command '{called(by)}'"
    return f" by {by}" if by not in ("", CENTRAL) else ""


def state_change(transition: str, state: str, module: str, text: str = "") -> str:
    """Return a transition: ``update by planner, now update requested: it slips``.

    Without a *state*, the state has not changed.
    """
    now, why = (f", now {state}" if state else ""), (f": {text}" if text else "")
    return f"{transition}{by_whom(module)}{now}{why}"


def kill_reason(why: str, by: str) -> str:
    """Return the reason for a kill and its requester, unless that is central."""
    requester = by_whom(by).strip()
    return f"{why} ({requester})" if why and requester else why or requester


def raised_by(by: str) -> str:
    """Return the module that raised a failure outside the handler; "" for central.

    For example " (raised by the command 'tca raise')".
    """
    requester = by_whom(by)
    return f" (raised{requester})" if requester else ""


def place(module: str, resource: str) -> str:
    """Return a module's resource; only the module's name where both have the same name."""
    return module if resource in ("", module) else f"{module} / {resource}"


_DUE = {
    Due.RELEASE: "end of a delay",
    Due.DEADLINE: "deadline",
    Due.ATTEMPT: "timeout of an attempt",
    Due.KILL: "time of the kill",
    Due.TEST: "time of the next test",
    Due.MONITOR_OVER: "end of the watch",
    Due.LOOK: "check for deadlocks",
    Due.HUNG: "check for a handler that hangs",
    Due.CLAIM: "timeout of a lock",
    Due.GRACE: "end of the wait for modules to reconnect after the restart",
}


def _date(began: float) -> str:
    try:
        return f"{datetime.fromtimestamp(began, UTC):%Y-%m-%d %H:%M:%S} UTC"
    except (ValueError, OverflowError, OSError):
        return "at an unknown time"


def _seconds(seconds: float) -> str:
    """Return seconds to the millisecond, without trailing zeros: ``3 s``, ``507.915 s``."""
    return f"{round(seconds, 3) if seconds >= 0.001 else seconds:.12g} s"


def _moment_of(fact: facts.WaitBegan | facts.WaitEnded) -> str:
    return f"{_moments(fact.moment)} of " if fact.moment else ""


def _moments(moments: int) -> str:
    return ", ".join(describe_moments(moments)) or f"moment {moments:d}"
