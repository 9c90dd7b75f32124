"""The requests of a script to central: in words, by library call, and as a predicate."""

from collections.abc import Callable
from typing import Any

import msgspec

from tca_module import checks
from tca_tools.explore.errors import ScenarioError
from tca_tools.explore.scenario.argument_checks import check
from tca_tools.properties.predicates import NamedPredicate
from tca_tools.properties.world import Predicate
from tca_wire.packets import headers
from tca_wire.packets.changes import ChangeState
from tca_wire.points import THIS
from tca_wire.text.facts_in_words import Wording
from tca_wire.text.nearest import nearest_or_all
from tca_wire.vocabulary import MessageClass


class RequestWording(Wording):
    """Requests in words. *name_of* returns the name of a task: "step {3}"."""

    def __init__(self, name_of: Callable[[int], str]) -> None:
        super().__init__()
        self._name_of = name_of

    def name(self, number: int) -> str:
        """Return the name of a task, or "it" for the task that is being sent."""
        return "it" if number == THIS else self._name_of(number)

    def request(self, header: Any, body: bytes, message_class: MessageClass | None) -> str:
        """Return a request as a verb phrase: "kills step {3} in 2 s".

        *message_class* is the class of the message that *header* names.
        """
        phrase = self.filled(
            REQUESTS.get(type(header), f"requests {type(header).__name__}"), header
        )
        data = data_in_words(body)
        if isinstance(header, headers.Send):
            watch = self.filled(_WATCH, header.watch) if header.watch is not None else ""
            verb = "prepares" if header.when_killed else "sends"
            return f"{verb} {message_class} {header.message}{data}{phrase}{watch}"
        return phrase + data


def data_in_words(body: bytes) -> str:
    """Return the data of a request as JSON, with a space in front; "" for none."""
    data = msgspec.msgpack.decode(body) if body else None
    return "" if data is None else f" {msgspec.json.encode(data, enc_hook=str).decode()}"


REQUESTS: dict[type, str] = {
    headers.Send: (
        "[when_killed? in case {parent:name} is killed][, within {deadline:seconds}]"
        "[, with {attachments:attachments}][if_handled?, if it is handled][suspended?, suspended]"
    ),
    headers.Constrain: "adds {constraints:constraints}",
    headers.AwaitPoint: "waits for {point:point}",
    headers.Kill: "kills {scope:scope}{task:name}[ in {delay:seconds}][ after {after:point}]",
    headers.Attach: "attaches {attachment:attachment} to [message?all {message}|{task:at}]",
    headers.Tap: (
        "taps [message?all {message}|{task:name}] {condition} with {listener}[at_once?, at once]"
    ),
    headers.Remove: "removes {id:number}",
    headers.Raise: "raises {failure} on {task:name}",
    headers.Retry: "retries {task:name}[new_data? with]",
    headers.Resolve: "reports its failure as resolved",
    headers.Suspend: "[resume?resumes|suspends] {task:name}",
    headers.Deadline: "requires {point:point} within {seconds:seconds}",
    headers.Inspect: "reads the {relation} of {task:name}",
    headers.Keep: "[release?releases|retains] {task:name}",
    headers.Fire: "fires [message?{message}|{monitor:name}] with",
    headers.EndMonitor: "ends {monitor:name}",
    headers.GetVariable: "gets {variable}",
    headers.SetVariable: "sets {variable} to",
    headers.Lock: "waits to [reserve?reserve|lock] {resource}",
    headers.Unlock: "unlocks {resource}",
    headers.WaitUntilHandled: "waits until {messages:list} are handled",
    ChangeState: "takes '{transition}' of {task:name}",
}
"""By type of request: its phrase, in the notation of facts. The phrase of a sent message comes
after the message's data.
"""
_WATCH = "[, every {period:seconds}][, for {duration:seconds}]"


def call_of(header: Any) -> str:
    """Return the module library's call that makes a request: one of CALLS."""
    calls = _CALLS[type(header)]
    if isinstance(calls, str):
        return calls
    first, second, is_second = calls
    return second if getattr(header, is_second) else first


_CALLS: dict[type, str | tuple[str, str, str]] = {
    headers.Send: ("send", "on_termination", "when_killed"),
    headers.Constrain: "constrain",
    headers.AwaitPoint: "wait_for",
    headers.Kill: "kill",
    headers.Attach: "on_failure",
    headers.Tap: "tap",
    headers.Remove: "remove",
    headers.Raise: "fail",
    headers.Retry: "retry",
    headers.Resolve: "resolved",
    headers.Suspend: ("suspend", "resume", "resume"),
    headers.Deadline: "deadline",
    headers.Inspect: "inspect",
    headers.Keep: ("keep", "release", "release"),
    headers.Fire: "fire",
    headers.EndMonitor: "end",
    headers.GetVariable: "get_variable",
    headers.SetVariable: ("set_variable", "swap_variable", "swap"),
    headers.Lock: ("lock", "reserve", "reserve"),
    headers.Unlock: "unlock",
    headers.WaitUntilHandled: "wait_until_handled",
    ChangeState: "take",
}
"""By type of request: its call; or two calls, and the field that only the second call sets."""

CALLS = tuple(
    call
    for calls in _CALLS.values()
    for call in ((calls,) if isinstance(calls, str) else calls[:2])
)
"""The calls of a script that reach central. "send" stands for goal(), query(), monitor(), ..."""


def accepted(call: str, by: str = "") -> Predicate:
    """Return a predicate that is true if central accepted such a request with the last action.

    A request that is refused, or comes too late to change anything, is not accepted. A wait or a
    lock is accepted when it begins.

    Args:
        call: the module library's call: "kill", "retry", "on_termination", ...; "send" for a
            message of any class.
        by: the name of the module that makes the request; any module by default.

    Raises:
        ScenarioError: There is no such call.
    """
    if call not in CALLS:
        raise ScenarioError(
            f"accepted() knows no call {call!r:.60}; {nearest_or_all(str(call), CALLS)}"
        )
    if by:
        check("accepted()", checks.NAME, by=by)
    return _Accepted(call, by)


class _Accepted(NamedPredicate):
    """The predicate that a request was accepted with the last action."""

    def __init__(self, call: str, by: str) -> None:
        super().__init__(f"{call}{f' of {by}' * bool(by)} accepted", module=by)
        self._call = call

    def __call__(self, world: Any) -> list[Any]:
        """Return a list of the accepted request; an empty list without one."""
        taken = world.taken
        if taken is None or taken.call != self._call:
            return []
        return [taken] if self.module in ("", taken.sender, taken.sender.partition("#")[0]) else []
