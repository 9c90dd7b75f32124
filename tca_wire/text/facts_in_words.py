"""The facts of a journal in words, one line each. Remembers the names of messages, and nothing else."""

from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any

from tca_wire.constraints import Constraint
from tca_wire.journal import facts
from tca_wire.journal.causes import Cause, ConnectionLost, TimeOver
from tca_wire.points import ROOT, Point, describe_moments
from tca_wire.vocabulary import CENTRAL, Due, Scope

_COMMAND = "tca "
"""How the modules are called that commands of the command line are: "tca kill"."""


GAVE_UP = "its sender gave up"
"""Why a message was dropped whose sender waits no longer; central may say after a colon where the message was then."""


class Wording:
    """Facts in words; a name stays known as long as facts about it may come. *known* names what was sent before."""

    def __init__(self, known: Callable[[int], str] = lambda _: "?") -> None:
        self._names: dict[int, str] = {}
        self._known = known

    def words(self, fact: facts.Fact) -> str:
        """What a fact says, without its kind and body."""
        if isinstance(fact, facts.Received):
            self._names[fact.id] = fact.message
        elif isinstance(fact, facts.Delivered | facts.Queued):
            self._names.setdefault(fact.id, self._names.get(fact.message_id) or self._known(fact.message_id))
        say = _SAY.get(type(fact))
        return say(self, fact) if say else ""

    def cause(self, cause: Cause) -> str:
        """What an entry came from: ``Kill by user, in the handler of walk {1}``."""
        if isinstance(cause, TimeOver):
            return _DUE[cause.due] + (f" of {self._name(cause.about)}" if cause.about else "")
        if isinstance(cause, ConnectionLost):
            return f"a connection of {cause.module} was lost"
        handler = f", in the handler of {self._name(cause.origin)}" if cause.origin else ""
        return f"{cause.message or 'no message'}{by_whom(cause.module)}{handler}"

    def _name(self, number: int) -> str:
        return f"{self._names.get(number) or self._known(number)} {{{number}}}"

    def _point(self, point: Point) -> str:
        return f"{_moments(point.moment)} of {self._name(point.task)}"

    def _constraints(self, constraints: list[Constraint]) -> str:
        return "; ".join(f"{self._before(c)} before {self._point(c.after)}" for c in constraints)

    def _before(self, constraint: Constraint) -> str:
        if constraint.before.task == ROOT:
            return _seconds(constraint.delay)
        return self._point(constraint.before) + (f" + {_seconds(constraint.delay)}" if constraint.delay else "")

    def _opened(self, fact: facts.Opened) -> str:
        try:
            began = f"{datetime.fromtimestamp(fact.began, UTC):%Y-%m-%d %H:%M:%S} UTC"
        except (ValueError, OverflowError, OSError):
            began = "at no known time"
        return f"segment {fact.segment} of {fact.epoch}, by central {fact.central}, began {began}"

    def _closed(self, fact: facts.Closed) -> str:
        return fact.why

    def _joined(self, fact: facts.ModuleJoined) -> str:
        return f"{fact.module}, {fact.process}" if fact.process else fact.module

    def _left(self, fact: facts.ModuleLeft) -> str:
        return f"{fact.module}: {fact.why}"

    def _resource(self, fact: facts.ResourceChanged) -> str:
        return f"{place(fact.module, fact.resource)} takes {fact.capacity} at a time"

    def _format(self, fact: facts.FormatDefined) -> str:
        return f"{fact.message_class} {fact.message}, declared by {fact.module}"

    def _handler(self, fact: facts.HandlerAdded) -> str:
        return f"{place(fact.module, fact.resource)} handles {fact.message}"

    def _no_handler(self, fact: facts.HandlerRemoved) -> str:
        return f"{fact.module} handles {fact.message} no longer"

    def _received(self, fact: facts.Received) -> str:
        words = f"{fact.message_class} {self._name(fact.id)} from {fact.sender}"
        if fact.parent:
            words += f" under {self._name(fact.parent)}"
        elif fact.origin:
            words += f" in {self._name(fact.origin)}"
        words += ", which waits" if fact.blocking else ""
        words += f", {fact.role} for {self._name(fact.about)}" if fact.role else ""
        after = [f"{_moments(c.after.moment)} after {self._before(c)}" for c in fact.constraints]
        return "; ".join([words, *after])

    def _constrained(self, fact: facts.Constrained) -> str:
        return self._constraints(fact.constraints)

    def _queued(self, fact: facts.Queued) -> str:
        where = place(fact.module, fact.resource) or "a handler"
        return f"{self._name(fact.message_id)} for {where}{_priority(fact.priority)}"

    def _unqueued(self, fact: facts.Unqueued) -> str:
        return self._name(fact.id)

    def _delivered(self, fact: facts.Delivered) -> str:
        copy = f" of message {{{fact.message_id}}}" if fact.id != fact.message_id else ""
        slot = f", slot {fact.slot}" if fact.slot > 1 else ""
        nested = ", while another message waits there" * fact.is_nested
        where = f"{place(fact.module, fact.resource)}{slot}{nested}"
        return f"{self._name(fact.id)}{copy} to {where}{_priority(fact.priority)}"

    def _returned(self, fact: facts.Returned) -> str:
        return f"{self._name(fact.id)}: {fact.outcome}"

    def _reached(self, fact: facts.Reached) -> str:
        return f"{self._name(fact.task)}: {_moments(fact.moments)}"

    def _failed(self, fact: facts.Failed) -> str:
        text = f": {fact.text}" if fact.text else ""
        return f"{self._name(fact.id)}{_copy_of(fact)}: {fact.failure}{text}{raised_by(fact.by)}"

    def _killed(self, fact: facts.Killed) -> str:
        return f"{self._name(fact.task)}: {kill_reason(fact.why, fact.by)}"

    def _dropped(self, fact: facts.Dropped) -> str:
        return f"{fact.message} {{{fact.id}}}{_copy_of(fact)}: {fact.why}" + (f": {fact.where}" if fact.where else "")

    def _answered(self, fact: facts.Answered) -> str:
        return self._name(fact.id)

    def _awaited(self, fact: facts.Awaited) -> str:
        return f"the answer to {self._name(fact.id)}"

    def _handled_directly(self, fact: facts.HandledDirectly) -> str:
        words = f"{fact.message} from {fact.sender} to {place(fact.module, fact.resource)}"
        words += f" in {self._name(fact.origin)}" if fact.origin else ""
        words += f", {fact.size} bytes, {fact.seconds:.6f} s: {fact.outcome}"
        return words + (f": {fact.failure}" if fact.failure else "")

    def _lost_directly(self, fact: facts.LostDirectly) -> str:
        return f"{fact.module}: {fact.number} of {fact.message or 'the notes of direct messages'}"

    def _wait_began(self, fact: facts.WaitBegan) -> str:
        return f"{self._waiter(fact)} until {_moments(fact.moment)} of {self._name(fact.task)}"

    def _wait_ended(self, fact: facts.WaitEnded) -> str:
        return f"{self._waiter(fact)} for {self._name(fact.task)}"

    def _waiter(self, fact: facts.WaitBegan | facts.WaitEnded) -> str:
        return f"{fact.module} in {self._name(fact.origin)}" if fact.origin else fact.module

    def _attached(self, fact: facts.Attached) -> str:
        at = f"all {fact.message}" if fact.message else self._name(fact.task) if fact.task else "all tasks"
        most = f", at most {fact.maximum} times" if fact.maximum else ""
        return f"{{{fact.id}}} {fact.handler} for {fact.failure or 'any failure'} of {at}{most}"

    def _removed(self, fact: facts.Removed) -> str:
        return f"{{{fact.id}}}{by_whom(fact.by)}"

    def _kept(self, fact: facts.Kept | facts.Released) -> str:
        return f"{self._name(fact.task)}{f' by {fact.module}' if fact.module else ': its record is gone'}"

    def _deadline(self, fact: facts.DeadlineSet) -> str:
        return f"{self._name(fact.task)}: {_moments(fact.moment)} within {_seconds(fact.seconds)}"

    def _kill_planned(self, fact: facts.KillPlanned) -> str:
        what = f"{fact.scope} of {self._name(fact.task)}" if fact.scope is not Scope.TASK else self._name(fact.task)
        after = f" after {self._point(fact.after)}" if fact.after is not None else ""
        delay = f" in {_seconds(fact.seconds)}" if fact.seconds else ""
        return f"{what}{delay}{after}: {kill_reason(fact.why, fact.by)}"

    def _send_planned(self, fact: facts.SendPlanned) -> str:
        return f"{fact.message} when {self._name(fact.task)} is killed"

    def _tap(self, fact: facts.TapAdded) -> str:
        at = self._name(fact.task) if fact.task else f"all {fact.message}"
        return f"{{{fact.id}}} {fact.listener} {fact.condition} of {at}{by_whom(fact.by)}"

    def _tap_fired(self, fact: facts.TapFired) -> str:
        listener = self._name(fact.listener) if fact.listener else "nobody"
        return f"{{{fact.tap}}} for {self._name(fact.tapped)}: {listener}"

    def _tested(self, fact: facts.MonitorTested) -> str:
        return f"{self._name(fact.monitor)}: {'holds' if fact.holds else 'does not hold'}"

    def _monitor_ended(self, fact: facts.MonitorEnded) -> str:
        return f"{self._name(fact.monitor)}: {fact.why}"

    def _caught(self, fact: facts.Caught) -> str:
        at = self._name(fact.at) if fact.at else "the root"
        return f"{self._name(fact.task)} by {self._name(fact.handler)}, attached to {at}"

    def _of_handler(self, fact: facts.Reissued) -> str:
        return self._name(fact.handler)

    def _unhandled(self, fact: facts.Unhandled) -> str:
        undecided = f", so {self._name(fact.undecided)} could not decide" if fact.undecided else ""
        return self._name(fact.task) + undecided

    def _of_task(self, fact: facts.Recovered) -> str:
        return self._name(fact.task)

    def _retried(self, fact: facts.Retried) -> str:
        return self._name(fact.task) + by_whom(fact.by)

    def _suspended(self, fact: facts.SuspendedOrResumed) -> str:
        return self._name(fact.task) + ("" if fact.is_suspended else " is resumed") + by_whom(fact.by)

    def _timed_out(self, fact: facts.TimedOut) -> str:
        before, after = fact.constraint.before, self._point(fact.constraint.after)
        since = "" if before.task == ROOT else f" after {self._point(before)},"
        return f"{_seconds(fact.constraint.delay)}{since} before {after}"

    def _claimed(self, fact: facts.Claimed) -> str:
        kind = "reservation" if fact.is_reserved else "lock"
        self._names[fact.id] = f"{kind} of {place(fact.module, fact.resource)}"
        by = f"{fact.sender} in {self._name(fact.origin)}" if fact.origin else fact.sender
        return f"{self._name(fact.id)} by {by}"

    def _granted(self, fact: facts.Granted) -> str:
        return self._name(fact.id)

    def _claim_ended(self, fact: facts.ClaimEnded) -> str:
        return f"{self._name(fact.id)}: {fact.why}"

    def _refused(self, fact: facts.RequestRefused) -> str:
        return f"{fact.sender}: {fact.refusal}: {fact.text}"

    def _ignored(self, fact: facts.Ignored) -> str:
        return f"{fact.sender}: {fact.text}"


def fields_of(fact: facts.Fact) -> dict[str, object]:
    """A fact as a dictionary for text forms: moments as words, bodies left out."""
    fields = {name: getattr(fact, name) for name in fact.__struct_fields__ if name != "body"}
    if isinstance(fact, facts.Reached):
        fields["moments"] = describe_moments(fact.moments)
    elif isinstance(fact, facts.WaitBegan | facts.DeadlineSet):
        fields["moment"] = ", ".join(describe_moments(fact.moment))
    return fields


def subject_of(fact: facts.Fact) -> int:
    """The message, task, lock or attachment that a fact is about; 0 for none."""
    fields = (getattr(fact, name, None) for name in ("task", "message_id", "id", "tapped", "monitor", "handler"))
    return next((number for number in fields if isinstance(number, int)), 0)


def called(module: str) -> str:
    """What a module calls itself: of several copies of a program the others are known as ``legs#2``, ``legs#3``."""
    return module.partition("#")[0]


def by_whom(by: str) -> str:
    """Who asked for something: " by legs", " by the command 'tca kill'"; "" of what central does of its own."""
    if by.startswith(_COMMAND):
        return f" by the command '{called(by)}'"
    return f" by {by}" if by not in ("", CENTRAL) else ""


def kill_reason(why: str, by: str) -> str:
    """Why a task was killed, and who wanted that; what central does of its own, the reason tells."""
    whom = by_whom(by).strip()
    return f"{why} ({whom})" if why and whom else why or whom


def raised_by(by: str) -> str:
    """Who raised a failure beside the handler: " (raised by the command 'tca raise')"; of what central raises, its text
    tells.
    """
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
    Due.CLAIM: "timeout of a lock",
}


def _priority(priority: int) -> str:
    return f", priority {priority}" if priority else ""


def _copy_of(fact: facts.Failed | facts.Dropped) -> str:
    return f" of message {{{fact.copy_of}}}" if fact.copy_of else ""


def _seconds(seconds: float) -> str:
    """To the millisecond, without noughts: ``3 s``, ``507.915 s``."""
    return f"{round(seconds, 3) if seconds >= 0.001 else seconds:.12g} s"


def _moments(moments: int) -> str:
    return ", ".join(describe_moments(moments)) or f"moment {moments:d}"


# ruff: noqa: SLF001
_SAY: dict[type, Callable[[Wording, Any], str]] = {
    facts.Opened: Wording._opened,
    facts.Closed: Wording._closed,
    facts.ModuleJoined: Wording._joined,
    facts.ModuleLeft: Wording._left,
    facts.ResourceChanged: Wording._resource,
    facts.FormatDefined: Wording._format,
    facts.HandlerAdded: Wording._handler,
    facts.HandlerRemoved: Wording._no_handler,
    facts.Received: Wording._received,
    facts.Constrained: Wording._constrained,
    facts.Queued: Wording._queued,
    facts.Unqueued: Wording._unqueued,
    facts.Delivered: Wording._delivered,
    facts.Returned: Wording._returned,
    facts.Reached: Wording._reached,
    facts.Failed: Wording._failed,
    facts.Killed: Wording._killed,
    facts.Dropped: Wording._dropped,
    facts.Answered: Wording._answered,
    facts.Awaited: Wording._awaited,
    facts.HandledDirectly: Wording._handled_directly,
    facts.LostDirectly: Wording._lost_directly,
    facts.WaitBegan: Wording._wait_began,
    facts.WaitEnded: Wording._wait_ended,
    facts.Attached: Wording._attached,
    facts.Removed: Wording._removed,
    facts.TapAdded: Wording._tap,
    facts.TapFired: Wording._tap_fired,
    facts.MonitorTested: Wording._tested,
    facts.MonitorEnded: Wording._monitor_ended,
    facts.Caught: Wording._caught,
    facts.Reissued: Wording._of_handler,
    facts.Unhandled: Wording._unhandled,
    facts.Recovered: Wording._of_task,
    facts.Retried: Wording._retried,
    facts.SuspendedOrResumed: Wording._suspended,
    facts.TimedOut: Wording._timed_out,
    facts.Claimed: Wording._claimed,
    facts.Granted: Wording._granted,
    facts.ClaimEnded: Wording._claim_ended,
    facts.DeadlineSet: Wording._deadline,
    facts.KillPlanned: Wording._kill_planned,
    facts.SendPlanned: Wording._send_planned,
    facts.Kept: Wording._kept,
    facts.Released: Wording._kept,
    facts.RequestRefused: Wording._refused,
    facts.Ignored: Wording._ignored,
}
