"""Services of central itself: variables, locks, and the directory."""

from collections.abc import Iterable
from difflib import get_close_matches
from typing import Any, Literal, Self, TypeVar, overload

import msgspec

from tca_module import checks
from tca_module.checks import check, is_brief
from tca_module.errors import LockLost, MisuseError, NotDeclared, Timeout, VariableNotSet
from tca_module.link.connection import ACKNOWLEDGED_WITHIN, Connection
from tca_module.link.questions import ask
from tca_module.sending.directory import (
    HandlerInfo,
    MessageInfo,
    ModuleInfo,
    handlers_of,
    messages_of,
    modules_of,
)
from tca_wire.life_cycles import read_life_cycle
from tca_wire.messages.controls import ExceptionHandler, Monitor
from tca_wire.messages.declarations import (
    Broadcast,
    Command,
    D,
    Goal,
    Inform,
    Message,
    MultiQuery,
    Query,
    TaskMessage,
    Variable,
)
from tca_wire.packets.headers import Ask, GetVariable, GoOn, Lock, Remove, SetVariable, Unlock, WaitUntilHandled
from tca_wire.text.plain_data import PlainFormat
from tca_wire.vocabulary import Outcome

X = TypeVar("X")
Topic = Literal["status", "modules", "messages", "tree", "variables", "load", "attached"]

_NO_DEFAULT: Any = object()
_DECLARED_WITHIN = 0.2  # seconds that central may take to know a message, where the sender would wait for less
_WHY_WITHIN = 0.2  # seconds that central may take to name the missing handlers after a timeout


class Claim:
    """A lock or reservation. The end of a ``with`` block releases it, and raises LockLost if it had been taken away,
    unless another error leaves the block.
    """

    def __init__(self, connection: Connection, header: Lock) -> None:
        self._connection = connection
        kind = "reservation" if header.reserve else "lock"
        self._what = f"the {kind} of resource '{header.resource}'" + (f" of '{header.module}'" * bool(header.module))
        self._request = connection.request(header, wants_answer=True, is_awaited=True)
        self._is_over = False

    def __repr__(self) -> str:
        return self._what

    def wait(self, timeout: float | None) -> None:
        """Wait until it is granted. Central knows the timeout, and says when it is over."""
        connection, request = self._connection, self._request
        is_over = connection.wait(request, timeout, self._what)
        if not is_over and not connection.silence:  # central, which knows when the time is over, is about to say so
            is_over = connection.wait(request, ACKNOWLEDGED_WITHIN, self._what)
        if not is_over:
            self._connection.abandon(self._request)
            why = self._connection.line.why_late(timeout or 0.0)
            raise Timeout(f"{self._what} was not granted within {timeout:g} s, {why}")
        answer, _ = self._request.answers[-1]
        if answer.outcome is not Outcome.DONE:
            self._is_over = True
            raise Timeout(f"{self._what} was not granted within {timeout:g} s: {answer.text}")

    @property
    def held(self) -> bool:
        """Whether it still holds, as far as is known here. Never waits: check it before each step that needs it."""
        return not (self._is_over or self._connection.is_taken(self._request))

    def release(self) -> None:
        """Let others in again; twice does no harm. Raises LockLost if it had been taken away, CentralLost if central
        does not answer; central is then told later.
        """
        if not self._end() and self._request.taken:
            raise self._lost()

    def _lost(self) -> LockLost:
        how = self._request.taken or "central does not know it any more: the connection was broken"
        return LockLost(f"{self._what} was lost before it was released: {how}; others may have been let in")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if not self._end(at_once=error is not None) and error is None:
            raise self._lost()

    def _end(self, *, at_once: bool = False) -> bool:
        """Release it; whether it still held, or had been released."""
        if self._is_over:
            return True
        self._connection.check_thread()  # refused in another thread, it can be released in its own
        self._is_over = True
        return self._connection.release(self._request, self._what, at_once=at_once)


class CentralServices:
    """The part of a Sender that asks central and no module."""

    _origin: int

    def _connection(self) -> Connection:
        """The connection of the calling thread."""
        raise NotImplementedError

    def _declare(self, *messages: Message[Any, Any], within: float = ACKNOWLEDGED_WITHIN) -> Connection:
        """The connection, with the messages and the parts of monitors among them declared on it."""
        connection = self._connection()
        if all(map(connection.has_declared, messages)):
            return connection
        parts = [part for one in messages if isinstance(one, Monitor) for part in one.parts if part is not None]
        connection.declare(*parts, *messages, within=within)
        return self._connection()  # which may have lost its central meanwhile

    def _declare_within(self, timeout: float | None, *messages: Message[Any, Any]) -> float | None:
        """Declare messages; the seconds left of the *timeout* of the wait that follows. Raises Timeout."""
        if timeout is None or timeout >= ACKNOWLEDGED_WITHIN:
            return timeout
        began = self._connection().now()
        connection = self._declare(*messages, within=max(timeout, _DECLARED_WITHIN))
        return max(0.0, timeout - (connection.now() - began))

    # --- variables -------------------------------------------------------------------------------------------------

    def set_variable(self, variable: Variable[D], value: D, *, wait: bool = True) -> None:
        """Give a variable a new value (TCA 7.7: SetVar). Returns when central has it; with *wait* False at once, for
        values that come many times a second: one may be lost while central is away.

        Raises BadData if *value* does not fit, Refused if all values together would be too large.
        """
        check("set_variable()", checks.VARIABLE, variable=variable)
        check("set_variable()", checks.FLAG, wait=wait)
        body = variable.encode_data(value)
        connection = self._declare(variable)
        header = SetVariable(0, variable.name, self._origin)
        if wait:
            connection.call(header, f"setting variable '{variable.name}'", body)
        else:
            connection.post(header, body)

    @overload
    def get_variable(self, variable: Variable[D]) -> D: ...
    @overload
    def get_variable(self, variable: Variable[D], default: X) -> D | X: ...
    def get_variable(self, variable: Variable[D], default: Any = _NO_DEFAULT) -> Any:
        """The newest value of a variable (TCA 7.7: GetVar); if never set *default*, or VariableNotSet is raised."""
        check("get_variable()", checks.VARIABLE, variable=variable)
        connection = self._declare(variable)
        body = ask(connection, GetVariable(0, variable.name), f"variable '{variable.name}'")
        if body:
            return variable.decode_data(body)
        if default is _NO_DEFAULT:
            raise VariableNotSet(f"variable '{variable.name}' was never set: set it first, watch it, or give a default")
        return default

    @overload
    def swap_variable(self, variable: Variable[D], value: D) -> D | None: ...
    @overload
    def swap_variable(self, variable: Variable[D], value: D, default: X) -> D | X: ...
    def swap_variable(self, variable: Variable[D], value: D, default: Any = None) -> Any:
        """Set a variable and return its value before, in one step (TCA 7.7: GetSetVar); *default* if it had none."""
        check("swap_variable()", checks.VARIABLE, variable=variable)
        body = variable.encode_data(value)
        connection = self._declare(variable)
        header = SetVariable(0, variable.name, self._origin, swap=True)
        before = ask(connection, header, f"exchanging variable '{variable.name}'", body)
        return variable.decode_data(before) if before else default

    # --- resources -------------------------------------------------------------------------------------------------

    def lock(
        self, resource: str, module: str | None = None, *, timeout: float | None = None, priority: int = 0
    ) -> Claim:
        """Let nobody into a resource, this module neither; returns when nobody is in it (TCA 8.5: LockResource).

        ::

            with task.lock("sensors"):
                ...

        ``release()`` or the end of a ``with`` block releases it, and raises LockLost if it was taken away before.
        Otherwise it ends with the task being handled, or with this module. *module* is needed where several modules
        have a resource of that name. It waits among the resource's messages by *priority*.

        Raises Timeout after *timeout* seconds (0: unless it is free now), Deadlock if it would wait for itself, Refused
        if there is no such resource.
        """
        return self._claim(resource, module, timeout, priority, reserve=False)

    def reserve(
        self, resource: str, module: str | None = None, *, timeout: float | None = None, priority: int = 0
    ) -> Claim:
        """Let in only what this module sends (TCA 8.5: ReserveResource); otherwise like ``lock``."""
        return self._claim(resource, module, timeout, priority, reserve=True)

    def unlock(self, resource: str, module: str | None = None) -> bool:
        """Take a lock or reservation away from its holder; whether there was one (TCA 8.5: ``unlock``). For operators.
        The holder is told: its handler or client with LockLost, else its task with the failure "lock lost".
        """
        check("unlock()", checks.NAME, resource=resource)
        check("unlock()", checks.NAME_OR_NONE, module=module)
        header = Unlock(0, resource, module or "", self._origin)
        return bool(self._connection().call(header, f"unlocking resource '{resource}'"))

    def go_on(self) -> bool:
        """Let tasks start again after a restart of central, whoever has not come back yet; whether they were held back.
        For operators: see ``tca central --resume hold``.
        """
        return bool(self._connection().call(GoOn(0), "letting tasks start again"))

    # --- attachments -----------------------------------------------------------------------------------------------

    def detach(self, number: int) -> bool:
        """Take away the exception handler or wiretap of that *number* (``tca attached``) whoever wants it, or end that
        monitor; whether it was still there. For operators. Raises Refused if there has never been that number, or it is
        a task.
        """
        check("detach()", checks.NUMBER, number=number)
        header = Remove(0, number, for_all=True, origin=self._origin)
        return bool(self._connection().call(header, f"detaching {number}"))

    def _claim(
        self, resource: str, module: str | None, timeout: float | None, priority: int, *, reserve: bool
    ) -> Claim:
        call = "reserve()" if reserve else "lock()"
        check(call, checks.NAME, resource=resource)
        check(call, checks.NAME_OR_NONE, module=module)
        check(call, checks.PRIORITY, priority=priority)
        brief = is_brief(call, timeout)
        check(call, checks.SECONDS, timeout=timeout or 0)
        seconds = -1 if timeout is None else timeout
        header = Lock(0, resource, module or "", reserve, self._origin, seconds, priority, blocking=True, brief=brief)
        claim = Claim(self._connection(), header)
        claim.wait(timeout)
        return claim

    # --- directory -------------------------------------------------------------------------------------------------

    def _ask_central(self, topic: Topic, within: float | None = ACKNOWLEDGED_WITHIN) -> bytes:
        return ask(self._connection(), Ask(0, topic), f"the question for {topic}", within=within)

    def modules(self) -> list[ModuleInfo]:
        """The modules that are connected, this one too."""
        return modules_of(self._ask_central("modules"))

    def messages(self) -> list[MessageInfo]:
        """The messages that are declared, with their formats and handlers."""
        return messages_of(self._ask_central("messages"))

    def handlers(self, message: Message[Any, Any]) -> list[HandlerInfo]:
        """The handlers of a message, newest first. The newest gets all messages, unless several share a pool."""
        self._declare(message)
        return handlers_of(self._ask_central("messages"))[message.name]

    def declared(self, name: str) -> Any:
        """The message or variable of that name, as some module has declared it, with plain values as data and replies.
        Raises NotDeclared if there is none, MisuseError for a monitor.
        """
        check("declared()", checks.TEXT, name=name)
        known = msgspec.msgpack.decode(self._ask_central("messages"))
        found = next((message for message in known if message["message"] == name), None)
        if found is None:
            nearest = get_close_matches(name, [message["message"] for message in known], n=1)
            advice = f"did you mean '{nearest[0]}'?" if nearest else "see 'tca messages', and start who declares it"
            raise NotDeclared(f"nobody has declared a message '{name}': {advice}")
        kind: type[Any] | None = _KINDS.get(found["class"])
        if kind is None:
            raise MisuseError(f"'{name}' is a {found['class']}: declare it in Python to have it watch")
        answers: dict[Any, str] = {Command: "result", Query: "reply", MultiQuery: "reply"}
        options: dict[str, Any] = {answers[kind]: PlainFormat(found["reply"])} if kind in answers else {}
        if issubclass(kind, TaskMessage):
            options["life_cycle"] = read_life_cycle(found["life_cycle"])
            options["progress"] = PlainFormat(found["progress"]) if found["progress"] else None
        message: Message[Any, Any] = kind(name, PlainFormat(found["data"]), **options)
        return message

    def wait_until_handled(self, *messages: Message[Any, Any], timeout: float | None = None) -> None:
        """Wait until each of the messages is handled. Raises Timeout, naming those that nobody handles."""
        check("wait_until_handled()", checks.TIMEOUT, timeout=timeout)
        try:
            left = self._declare_within(timeout, *messages)
        except Timeout:
            why = self._connection().silence or "central had not heard of them yet"
            raise Timeout(f"the wait for handlers was not over within {timeout:g} s: {why}") from None
        connection = self._declare(*messages)
        wanted = WaitUntilHandled(0, [message.name for message in messages], [], self._origin)
        request = connection.request(wanted, wants_answer=True, is_awaited=True)
        if not connection.wait(request, left, "the wait for handlers"):
            connection.abandon(request)
            if silence := connection.silence:
                raise Timeout(f"the wait for handlers was not over within {timeout:g} s: {silence}")
            raise Timeout(f"{self._unhandled(messages, timeout)}; start the module that does, see 'tca messages'")

    def _unhandled(self, messages: Iterable[Message[Any, Any]], timeout: float | None) -> str:
        named = {message.name: message.title for message in messages}
        try:
            answer = self._ask_central("messages", _WHY_WITHIN)
        except Timeout:
            return f"not all handled within {timeout:g} s: {', '.join(named.values())}"
        known = handlers_of(answer)
        missing = [name for name in named if not any(handler.capacity for handler in known.get(name, ()))]
        return f"not handled within {timeout:g} s: {', '.join(named[name] for name in missing)}"


_KINDS: dict[str, Any] = {
    str(kind.message_class): kind
    for kind in (Inform, Query, Broadcast, MultiQuery, Goal, Command, Variable, ExceptionHandler)
}
