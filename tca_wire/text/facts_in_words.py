"""The facts of a journal in words, one line each. Remembers the names of messages, and nothing else."""

from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any

from tca_wire.constraints import Constraint
from tca_wire.journal import facts
from tca_wire.journal.causes import Cause, ConnectionLost, Keeper, TimeOver
from tca_wire.points import ROOT, Point, describe_moments
from tca_wire.vocabulary import CENTRAL, Due, Scope
from tca_wire.waits import WaitKind

_COMMAND = "tca "
"""The first part of the module names of command-line tools: "tca kill"."""


class Wording:
    """Facts in words; a name stays known as long as facts about it may come. *known* names earlier messages."""

    def __init__(self, known: Callable[[int], str] = lambda _: "?") -> None:
        self._names: dict[int, str] = {}
        self._known = known

    def words(self, fact: facts.Fact) -> str:
        """A fact in words, without its kind and body."""
        if isinstance(fact, facts.Received):
            self._names[fact.id] = fact.message
        elif isinstance(fact, facts.Delivered | facts.Queued):
            self._names.setdefault(fact.id, self._names.get(fact.message_id) or self._known(fact.message_id))
        say = _SAY.get(type(fact))
        return say(self, fact) if say else self.name(getattr(fact, fact.__struct_fields__[0]))

    def cause(self, cause: Cause) -> str:
        """The cause of an entry: ``Kill by user, in the handler of walk {1}``."""
        if isinstance(cause, TimeOver):
            return _DUE[cause.due] + (f" of {self.name(cause.about)}" if cause.about else "")
        if isinstance(cause, ConnectionLost):
            return f"a connection of {cause.module} was lost"
        if isinstance(cause, Keeper):
            return "whoever runs central"
        handler = f", in the handler of {self.name(cause.origin)}" if cause.origin else ""
        return f"{cause.message or 'no message'}{by_whom(cause.module)}{handler}"

    def name(self, number: int) -> str:
        """A message, task or lock: ``walk {1}``."""
        return f"{self._names.get(number) or self._known(number)} {{{number}}}"

    def point(self, point: Point) -> str:
        """A point: ``end handling of walk {1}``."""
        return f"{_moments(point.moment)} of {self.name(point.task)}"

    def before(self, constraint: Constraint) -> str:
        """The point and delay that a constraint waits for: ``end handling of walk {1} + 2 s``, or the delay alone."""
        if constraint.before.task == ROOT:
            return _seconds(constraint.delay)
        return self.point(constraint.before) + (f" + {_seconds(constraint.delay)}" if constraint.delay else "")

    def claim(self, fact: facts.Claimed) -> str:
        """The lock or reservation and its claimant; its id has that name from now on."""
        kind = "reservation" if fact.is_reserved else "lock"
        self._names[fact.id] = f"{kind} of {place(fact.module, fact.resource)}"
        return f"{self.name(fact.id)} by {self.sender(fact.sender, fact.origin)}"

    def sender(self, module: str, origin: int) -> str:
        """A module and, if one asks, the handler: ``legs in walk {1}``."""
        return f"{module} in {self.name(origin)}" if origin else module


# --- facts of several parts -------------------------------------------------------------------------------------------


def _restarted(_: Wording, fact: facts.CentralRestarted) -> str:
    until = "somebody says so" if fact.hold else "all are back or lost"
    lost = f"; the last inputs may be missing, {fact.aside} entries were put aside" if fact.may_lack else ""
    return f"away for {_seconds(fact.away)}, {fact.awaited} connections awaited; no task starts until {until}{lost}"


def _opened(_: Wording, fact: facts.Opened) -> str:
    try:
        began = f"{datetime.fromtimestamp(fact.began, UTC):%Y-%m-%d %H:%M:%S} UTC"
    except (ValueError, OverflowError, OSError):
        began = "at no known time"
    return f"segment {fact.segment} of {fact.epoch}, by central {fact.central}, began {began}"


def _received(say: Wording, fact: facts.Received) -> str:
    words = f"{fact.message_class} {say.name(fact.id)} from {fact.sender}"
    if fact.parent:
        words += f" under {say.name(fact.parent)}"
    elif fact.origin:
        words += f" in {say.name(fact.origin)}"
    words += ", which waits" if fact.blocking else ""
    words += f", {fact.role} for {say.name(fact.about)}" if fact.role else ""
    return "; ".join([words, *(f"{_moments(c.after.moment)} after {say.before(c)}" for c in fact.constraints)])


def _delivered(say: Wording, fact: facts.Delivered) -> str:
    copy = f" of message {{{fact.message_id}}}" if fact.id != fact.message_id else ""
    slot = f", slot {fact.slot}" if fact.slot > 1 else ""
    nested = ", while another message waits there" * fact.is_nested
    where = f"{place(fact.module, fact.resource)}{slot}{nested}"
    return f"{say.name(fact.id)}{copy} to {where}{_priority(fact.priority)}"


def _handled_directly(say: Wording, fact: facts.HandledDirectly) -> str:
    words = f"{fact.message} from {fact.sender} to {place(fact.module, fact.resource)}"
    words += f" in {say.name(fact.origin)}" if fact.origin else ""
    return f"{words}, {fact.size} bytes, {fact.seconds:.6f} s: {fact.outcome}{_after_colon(fact.failure)}"


def _attached(say: Wording, fact: facts.Attached) -> str:
    at = f"all {fact.message}" if fact.message else say.name(fact.task) if fact.task else "all tasks"
    most = f", at most {fact.maximum} times" if fact.maximum else ""
    return f"{{{fact.id}}} {fact.handler} for {fact.failure or 'any failure'} of {at}{most}"


def _kept(say: Wording, fact: facts.Kept | facts.Released) -> str:
    return f"{say.name(fact.task)}{f' by {fact.module}' if fact.module else ': its record is gone'}"


def _kill_planned(say: Wording, fact: facts.KillPlanned) -> str:
    what = f"{fact.scope} of {say.name(fact.task)}" if fact.scope is not Scope.TASK else say.name(fact.task)
    after = f" after {say.point(fact.after)}" if fact.after is not None else ""
    delay = f" in {_seconds(fact.seconds)}" if fact.seconds else ""
    return f"{what}{delay}{after}: {kill_reason(fact.why, fact.by)}"


def _tap(say: Wording, fact: facts.TapAdded) -> str:
    at = say.name(fact.task) if fact.task else f"all {fact.message}"
    return f"{{{fact.id}}} {fact.listener} {fact.condition} of {at}{by_whom(fact.by)}"


def _unhandled(say: Wording, fact: facts.Unhandled) -> str:
    undecided = f", so {say.name(fact.undecided)} could not decide" if fact.undecided else ""
    return say.name(fact.task) + undecided


def _timed_out(say: Wording, fact: facts.TimedOut) -> str:
    before, after = fact.constraint.before, say.point(fact.constraint.after)
    since = "" if before.task == ROOT else f" after {say.point(before)},"
    return f"{_seconds(fact.constraint.delay)}{since} before {after}"


_SAY: dict[type, Callable[[Wording, Any], str]] = {
    facts.Opened: _opened,
    facts.Closed: lambda _, fact: fact.why,
    facts.CentralFailed: lambda _, fact: fact.why,
    facts.CentralRestarted: _restarted,
    facts.Shortened: lambda _, fact: f"what had ended by {fact.until:.3f} s was removed ('tca log prune')",
    facts.DiskSpace: lambda _, fact: f"the disk of the journal {'is nearly full' if fact.is_low else 'has room again'}",
    facts.WentOn: lambda _, fact: f"tasks start again{by_whom(fact.by) if fact.by else ''}",
    facts.ModuleJoined: lambda _, fact: ", ".join(filter(None, (fact.module, fact.process, fact.principal))),
    facts.KeysChanged: lambda _, fact: "; ".join(
        f"{what} {', '.join(names)}" for what, names in (("allowed", fact.allowed), ("revoked", fact.revoked)) if names
    ),
    facts.ModuleLeft: lambda _, fact: f"{fact.module}: {fact.why}",
    facts.PermissionsChanged: lambda _, fact: (
        f"{fact.rules} rule{'s' * (fact.rules != 1)} of {fact.source}"
        if fact.rules >= 0
        else "whoever gets in may do everything"
    ),
    facts.ResourceChanged: lambda _, fact: f"{place(fact.module, fact.resource)} takes {fact.capacity} at a time",
    facts.Recalling: lambda _, fact: (
        f"{place(fact.module, fact.resource)} {'has said' if fact.is_over else 'is asked'} what it has not begun"
    ),
    facts.FormatDefined: lambda _, fact: f"{fact.message_class} {fact.message}, declared by {fact.module}",
    facts.HandlerAdded: lambda _, fact: f"{place(fact.module, fact.resource)} handles {fact.message}",
    facts.HandlerRemoved: lambda _, fact: f"{fact.module} handles {fact.message} no longer",
    facts.RequestRefused: lambda _, fact: f"{fact.sender}: {fact.refusal}: {fact.text}",
    facts.Ignored: lambda _, fact: f"{fact.sender}: {fact.text}",
    facts.Received: _received,
    facts.Queued: lambda say, fact: (
        f"{say.name(fact.message_id)} for {place(fact.module, fact.resource) or 'a handler'}{_priority(fact.priority)}"
    ),
    facts.Delivered: _delivered,
    facts.Returned: lambda say, fact: f"{say.name(fact.id)}: {fact.outcome}",
    facts.Dropped: lambda _, fact: (
        f"{fact.message} {{{fact.id}}}{_copy_of(fact)}: {fact.why}{_after_colon(fact.where)}"
    ),
    facts.HandledDirectly: _handled_directly,
    facts.LostDirectly: lambda _, fact: (
        f"{fact.module}: {fact.number} of {fact.message or 'the notes of direct messages'}"
    ),
    facts.Constrained: lambda say, fact: "; ".join(
        f"{say.before(c)} before {say.point(c.after)}" for c in fact.constraints
    ),
    facts.TimedOut: _timed_out,
    facts.Reached: lambda say, fact: f"{say.name(fact.task)}: {_moments(fact.moments)}",
    facts.Killed: lambda say, fact: f"{say.name(fact.task)}: {kill_reason(fact.why, fact.by)}",
    facts.KillPlanned: _kill_planned,
    facts.SendPlanned: lambda say, fact: f"{fact.message} when {say.name(fact.task)} is killed",
    facts.DeadlineSet: lambda say, fact: (
        f"{say.name(fact.task)}: {_moments(fact.moment)} within {_seconds(fact.seconds)}"
    ),
    facts.SuspendedOrResumed: lambda say, fact: (
        say.name(fact.task) + ("" if fact.is_suspended else " is resumed") + by_whom(fact.by)
    ),
    facts.StateChanged: lambda say, fact: (
        f"{say.name(fact.task)}: {state_change(fact.transition, fact.state, fact.module, fact.text)}"
    ),
    facts.Kept: _kept,
    facts.Released: _kept,
    facts.Awaited: lambda say, fact: f"the answer to {say.name(fact.id)}",
    facts.WaitBegan: lambda say, fact: (
        f"{say.sender(fact.module, fact.origin)} until {_moments(fact.moment)} of {say.name(fact.task)}"
        if fact.awaits is WaitKind.TASK
        else f"{say.sender(fact.module, fact.origin)} for {_awaited(say, fact)}"
    ),
    facts.WaitEnded: lambda say, fact: f"{say.sender(fact.module, fact.origin)} for {_awaited(say, fact)}",
    facts.Claimed: Wording.claim,
    facts.ClaimEnded: lambda say, fact: f"{say.name(fact.id)}: {fact.why}",
    facts.Failed: lambda say, fact: (
        f"{say.name(fact.id)}{_copy_of(fact)}: {fact.failure}{_after_colon(fact.text)}{raised_by(fact.by)}"
    ),
    facts.Attached: _attached,
    facts.Removed: lambda _, fact: f"{{{fact.id}}}{by_whom(fact.by)}",
    facts.Caught: lambda say, fact: (
        f"{say.name(fact.task)} by {say.name(fact.handler)}, attached to {say.name(fact.at) if fact.at else 'the root'}"
    ),
    facts.NotResolved: lambda say, fact: (
        f"{say.name(fact.handler)} returned without dealing with the failure of {say.name(fact.task)}"
    ),
    facts.Unhandled: _unhandled,
    facts.Retried: lambda say, fact: say.name(fact.task) + by_whom(fact.by),
    facts.TapAdded: _tap,
    facts.TapFired: lambda say, fact: (
        f"{{{fact.tap}}} for {say.name(fact.tapped)}: {say.name(fact.listener) if fact.listener else 'nobody'}"
    ),
    facts.MonitorTested: lambda say, fact: f"{say.name(fact.monitor)}: {'holds' if fact.holds else 'does not hold'}",
    facts.MonitorEnded: lambda say, fact: f"{say.name(fact.monitor)}: {fact.why}",
}
"""The wording of each kind of fact that is told by more than the name of what it is about, its first field."""


def fields_of(fact: facts.Fact) -> dict[str, object]:
    """A fact as a dictionary for text forms: moments as words, bodies left out."""
    fields = {name: getattr(fact, name) for name in fact.__struct_fields__ if name != "body"}
    if isinstance(fact, facts.Reached):
        fields["moments"] = describe_moments(fact.moments)
    elif isinstance(fact, facts.WaitBegan | facts.DeadlineSet):
        fields["moment"] = ", ".join(describe_moments(fact.moment))
    if isinstance(fact, facts.WaitBegan | facts.WaitEnded):  # of the one for a task only that is told
        fields = {name: value for name, value in fields.items() if value or name == "origin"}
        if fact.awaits is WaitKind.TASK:
            del fields["awaits"]
    return fields


def subject_of(fact: facts.Fact) -> int:
    """The message, task, lock or attachment that a fact is about; 0 for none."""
    fields = (getattr(fact, name, None) for name in ("task", "message_id", "id", "tapped", "monitor", "handler"))
    return next((number for number in fields if isinstance(number, int)), 0)


def called(module: str) -> str:
    """A module's own name: further copies of a program are known as ``legs#2``, ``legs#3``."""
    return module.partition("#")[0]


def by_whom(by: str) -> str:
    """The requester in words: " by legs", " by the command 'tca kill'"; "" for central itself."""
    if by.startswith(_COMMAND):
        return f" by the command '{called(by)}'"
    return f" by {by}" if by not in ("", CENTRAL) else ""


def state_change(transition: str, state: str, module: str, text: str = "") -> str:
    """A transition of a task's life cycle: ``update by planner, now update requested: it slips``. Without a *state*,
    that stays as it was.
    """
    return f"{transition}{by_whom(module)}{f', now {state}' if state else ''}{_after_colon(text)}"


def kill_reason(why: str, by: str) -> str:
    """The reason for a kill and its requester, unless that is central."""
    whom = by_whom(by).strip()
    return f"{why} ({whom})" if why and whom else why or whom


def raised_by(by: str) -> str:
    """The origin of a failure from outside the handler: " (raised by the command 'tca raise')"; "" for central."""
    whom = by_whom(by)
    return f" (raised{whom})" if whom else ""


def place(module: str, resource: str) -> str:
    """A module's resource: only the module's name where both are named alike."""
    return module if resource in ("", module) else f"{module} / {resource}"


_DUE = {
    Due.RELEASE: "end of a delay",
    Due.DEADLINE: "deadline",
    Due.KILL: "time of the kill",
    Due.TEST: "time of the next test",
    Due.WATCHED: "end of the watch",
    Due.LOOK: "look for deadlocks",
    Due.HUNG: "look for a handler that hangs",
    Due.CLAIM: "timeout of a lock",
    Due.GRACE: "end of the wait for those who were there before the restart",
}


def _after_colon(text: str) -> str:
    return f": {text}" if text else ""


def _priority(priority: int) -> str:
    return f", priority {priority}" if priority else ""


def _copy_of(fact: facts.Failed | facts.Dropped) -> str:
    return f" of message {{{fact.copy_of}}}" if fact.copy_of else ""


def _seconds(seconds: float) -> str:
    """To the millisecond, without noughts: ``3 s``, ``507.915 s``."""
    return f"{round(seconds, 3) if seconds >= 0.001 else seconds:.12g} s"


def _awaited(say: Wording, fact: facts.WaitBegan | facts.WaitEnded) -> str:
    what = {WaitKind.CHANGE: "a change of ", WaitKind.PRESENCE: "handlers of "}.get(fact.awaits, "")
    return what + (fact.name or say.name(fact.task))


def _moments(moments: int) -> str:
    return ", ".join(describe_moments(moments)) or f"moment {moments:d}"
