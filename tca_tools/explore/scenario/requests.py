"""The requests of a script to central: in words, by the call of the library, and as a predicate."""

from collections.abc import Callable
from typing import Any

import msgspec

from tca_module import checks
from tca_tools.explore.errors import ScenarioError
from tca_tools.explore.scenario.argument_checks import check
from tca_tools.properties.predicates import NamedPredicate
from tca_tools.properties.world import Predicate
from tca_wire.constraints import Constraint
from tca_wire.packets import headers
from tca_wire.packets.changes import ChangeState
from tca_wire.packets.parts import Attachment
from tca_wire.points import ROOT, THIS, Point, describe_moments
from tca_wire.text.measures import counted
from tca_wire.text.nearest import nearest_or_all
from tca_wire.vocabulary import MessageClass, Scope

Name = Callable[[int], str]
"""How a task is called: "step {3}"."""


def in_words(header: Any, body: bytes, message_class: MessageClass | None, name: Name) -> str:
    """A header as what somebody does: "kills step {3} in 2 s". *message_class* is that of the message it names."""
    if isinstance(header, headers.Send):
        return _send(header, body, message_class, name)
    say = _SAY.get(type(header))
    return (say(header, name) if say else f"asks for {type(header).__name__}") + data_in_words(body)


def data_in_words(body: bytes) -> str:
    """Data behind what they were sent with."""
    data = msgspec.msgpack.decode(body) if body else None
    return "" if data is None else f" {msgspec.json.encode(data, enc_hook=str).decode()}"


def point_in_words(point: Point, name: Name) -> str:
    """A point of a task."""
    return f"{describe_moments(point.moment)[0]} of {'it' if point.task == THIS else name(point.task)}"


def _send(header: headers.Send, body: bytes, message_class: MessageClass | None, name: Name) -> str:
    what = f"{message_class} {header.message}{data_in_words(body)}"
    if header.when_killed:
        return f"wants {what} sent if {name(header.parent)} is killed"
    watch = header.watch
    parts = [
        f"every {watch.period:g} s" if watch is not None and watch.period else "",
        f"for {watch.duration:g} s" if watch is not None and watch.duration else "",
        f"within {header.deadline:g} s" if header.deadline else "",
        *(f"with {_recovery(one)}" for one in header.attachments),
        *(f"not before {one.delay:g} s" for one in header.constraints if one.delay and one.before.task == ROOT),
        "if it is handled" if header.if_handled else "",
        "suspended" if header.suspended else "",
    ]
    return ", ".join([f"sends {what}", *(part for part in parts if part)])


def _constraint(constraint: Constraint, name: Name) -> str:
    after = point_in_words(constraint.after, name)
    if constraint.before.task == ROOT:
        return f"{constraint.delay:g} s before {after}"
    late = f" + {constraint.delay:g} s" if constraint.delay else ""
    return f"{point_in_words(constraint.before, name)}{late} before {after}"


def _kill(header: headers.Kill, name: Name) -> str:
    what = "" if header.scope is Scope.TASK else f"the {header.scope} of "
    late = f" in {header.delay:g} s" if header.delay else ""
    after = f" after {point_in_words(header.after, name)}" if header.after is not None else ""
    return f"kills {what}{name(header.task)}{late}{after}"


def _attach(header: headers.Attach, name: Name) -> str:
    where = f"all {header.message}" if header.message else name(header.task) if header.task else "the root"
    return f"attaches {_recovery(header.attachment)} to {where}"


def _recovery(one: Attachment) -> str:
    often = f", {counted(one.maximum, 'time')} at most" if one.maximum else ""
    return f"{one.handler} for {one.failure or 'any failure'}{often}"


def _tap(header: headers.Tap, name: Name) -> str:
    return f"taps {f'all {header.message}' if header.message else name(header.task)} {header.condition} with \
{header.listener}{', at once' * header.at_once}"


def call_of(header: Any) -> str:
    """The call of the module library by which a script asked for that: one of CALLS."""
    call = _CALLS[type(header)]
    return call if isinstance(call, str) else call[bool(getattr(header, _SECOND[type(header)]))]


_CALLS: dict[type, str | tuple[str, str]] = {
    headers.Send: ("send", "on_termination"),
    headers.Constrain: "constrain",
    headers.AwaitPoint: "wait_for",
    headers.Kill: "kill",
    headers.Attach: "on_failure",
    headers.Tap: "tap",
    headers.Remove: "remove",
    headers.Raise: "fail",
    headers.Retry: "retry",
    headers.Resolve: "resolved",
    headers.Suspend: ("suspend", "resume"),
    headers.Deadline: "deadline",
    headers.Inspect: "inspect",
    headers.Keep: ("keep", "release"),
    headers.Fire: "fire",
    headers.EndMonitor: "end",
    headers.GetVariable: "get_variable",
    headers.SetVariable: ("set_variable", "swap_variable"),
    headers.Lock: ("lock", "reserve"),
    headers.Unlock: "unlock",
    headers.WaitUntilHandled: "wait_until_handled",
    ChangeState: "take",
}
_SECOND: dict[type, str] = {
    headers.Send: "when_killed",
    headers.Suspend: "resume",
    headers.Keep: "release",
    headers.SetVariable: "swap",
    headers.Lock: "reserve",
}
"""By what the second of two calls is known."""

CALLS = tuple(call for one in _CALLS.values() for call in ((one,) if isinstance(one, str) else one))
"""The requests that a script can make. "send" stands for all that is sent: goal(), query(), inform(), monitor(), ..."""

_SAY: dict[type, Callable[[Any, Name], str]] = {
    headers.Constrain: lambda header, name: f"adds {'; '.join(_constraint(one, name) for one in header.constraints)}",
    headers.AwaitPoint: lambda header, name: f"waits for {point_in_words(header.point, name)}",
    headers.Kill: _kill,
    headers.Attach: _attach,
    headers.Tap: _tap,
    headers.Remove: lambda header, _: f"removes {{{header.id}}}",
    headers.Raise: lambda header, name: f"raises {header.failure} on {name(header.task)}",
    headers.Retry: lambda header, name: f"retries {name(header.task)}{' with' if header.new_data else ''}",
    headers.Resolve: lambda _, __: "says that its failure is resolved",
    headers.Suspend: lambda header, name: f"{'resumes' if header.resume else 'suspends'} {name(header.task)}",
    headers.Deadline: lambda header, name: f"wants {point_in_words(header.point, name)} within {header.seconds:g} s",
    headers.Inspect: lambda header, name: f"looks at the {header.relation} of {name(header.task)}",
    headers.Keep: lambda header, name: f"{'lets go of' if header.release else 'keeps'} {name(header.task)}",
    headers.Fire: lambda header, name: f"fires {header.message or name(header.monitor)} with",
    headers.EndMonitor: lambda header, name: f"ends {name(header.monitor)}",
    headers.GetVariable: lambda header, _: f"gets {header.variable}",
    headers.SetVariable: lambda header, _: f"sets {header.variable} to",
    headers.Lock: lambda header, _: f"wants to {'reserve' if header.reserve else 'lock'} {header.resource}",
    headers.Unlock: lambda header, _: f"frees {header.resource}",
    headers.WaitUntilHandled: lambda header, _: f"waits until {', '.join(header.messages)} are handled",
    ChangeState: lambda header, name: f"takes '{header.transition}' of {name(header.task)}",
}


def accepted(call: str, by: str = "") -> Predicate:
    """With the last action: that central took what a script (of the module *by*) asked for by this call of the module
    library: "kill", "retry", "on_termination", ...; "send" is a message of any class. What is refused, or comes too
    late to change anything, is not accepted; a wait or a lock is accepted when it begins.
    """
    if call not in CALLS:
        raise ScenarioError(f"accepted() knows no call {call!r:.60}; {nearest_or_all(str(call), CALLS)}")
    if by:
        check("accepted()", checks.NAME, by=by)
    return _Accepted(call, by)


class _Accepted(NamedPredicate):
    """That a request was taken."""

    def __init__(self, call: str, by: str) -> None:
        super().__init__(f"{call}{f' of {by}' * bool(by)} accepted", module=by)
        self._call = call

    def __call__(self, world: Any) -> list[Any]:
        """That request, if it was taken with the last action."""
        taken = world.taken
        if taken is None or taken.call != self._call:
            return []
        return [taken] if self.module in ("", taken.sender, taken.sender.partition("#")[0]) else []
