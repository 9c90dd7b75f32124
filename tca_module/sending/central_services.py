"""What a Sender asks of central itself: variables, locks, and the directory."""

from collections import deque
from collections.abc import Callable, Iterable
from functools import cached_property
from typing import Any, Literal, TypeVar, overload

import msgspec

from tca_module import checks
from tca_module.checks import EXECUTED, check, is_brief
from tca_module.errors import MisuseError, NotDeclared, Timeout, VariableNotSet
from tca_module.link.connection import ACKNOWLEDGED_WITHIN, Connection
from tca_module.sending.claim import Claim
from tca_module.sending.directory import HandlerInfo, MessageInfo, ModuleInfo
from tca_module.sending.sibling_order import SiblingOrder
from tca_wire.life_cycles import read_life_cycle
from tca_wire.messages.controls import ExceptionHandler, Monitor
from tca_wire.messages.declarations import (
    Command,
    D,
    Message,
    MultiQuery,
    Query,
    TaskMessage,
    Variable,
)
from tca_wire.packets import headers
from tca_wire.points import ROOT, TaskId
from tca_wire.text.nearest import did_you_mean
from tca_wire.text.plain_data import PlainFormat

X = TypeVar("X")
Topic = Literal["status", "modules", "messages", "tree", "variables", "load", "attached"]

_NO_DEFAULT: Any = object()
_DECLARED_WITHIN = (
    0.2  # seconds that central may take to know a message, where the sender would wait for less
)
_WHY_WITHIN = 0.2  # seconds that central may take to name the missing handlers after a timeout

MOST_SENT = 10_000
"""Tasks that a Sender knows to have sent: the newest."""


class CentralServices:
    """The base of a Sender: its place in the tree, and what it asks of central and no module."""

    def __init__(
        self,
        parent: TaskId = ROOT,
        origin: int = 0,
        *,
        is_shared: bool = False,
        connection: Callable[[], Connection] | None = None,
    ) -> None:
        """*is_shared*: others send under the same *parent*, as everybody does under the root.
        *connection* gives that of the calling thread, unless a class has one of its own.
        """
        self._given_connection = connection
        self._parent = parent
        self._origin = origin
        self._is_shared = is_shared or parent == ROOT

    @cached_property
    def _ordering(self) -> SiblingOrder:
        """Made when it is first needed: most handlers send no tasks."""
        return SiblingOrder(is_shared=self._is_shared)

    @cached_property
    def _sent(self) -> deque[tuple[float, str, TaskId]]:
        """The newest tasks that it has sent, with the times and messages."""
        return deque(maxlen=MOST_SENT)

    def _connection(self) -> Connection:
        """The connection of the calling thread."""
        assert self._given_connection is not None
        return self._given_connection()

    def _declare(
        self, *messages: Message[Any, Any], within: float = ACKNOWLEDGED_WITHIN
    ) -> Connection:
        """The connection, with the messages and the parts of monitors among them declared on it."""
        connection = self._connection()
        if all(map(connection.has_declared, messages)):
            return connection
        parts = [
            part
            for one in messages
            if isinstance(one, Monitor)
            for part in one.parts
            if part is not None
        ]
        connection.declare(*parts, *messages, within=within)
        return self._connection()  # which may have lost its central meanwhile

    def _declare_within(self, timeout: float | None, *messages: Message[Any, Any]) -> float | None:
        """Declare messages; the seconds left of the *timeout* of the wait that follows. Raises
        Timeout.
        """
        if timeout is None or timeout >= ACKNOWLEDGED_WITHIN:
            return timeout
        began = self._connection().now()
        connection = self._declare(*messages, within=max(timeout, _DECLARED_WITHIN))
        return max(0.0, timeout - (connection.now() - began))

    # --- variables --------------------------------------------------------------------------------

    def set_variable(self, variable: Variable[D], value: D, *, wait: bool = True) -> None:
        """Give a variable a new value (TCA 7.7: SetVar). Returns when central has it; with *wait*
        False at once, for values that come many times a second: one may be lost while central is
        away.

        Raises BadData if *value* does not fit, Refused if all values together would be too large.
        """
        check("set_variable()", checks.VARIABLE, variable=variable)
        check("set_variable()", checks.FLAG, wait=wait)
        body = variable.encode_data(value)
        connection = self._declare(variable)
        header = headers.SetVariable(0, variable.name, self._origin)
        if wait:
            connection.call(header, f"setting variable '{variable.name}'", body)
        else:
            connection.post(header, body)

    @overload
    def get_variable(self, variable: Variable[D]) -> D: ...
    @overload
    def get_variable(self, variable: Variable[D], default: X) -> D | X: ...
    def get_variable(self, variable: Variable[D], default: Any = _NO_DEFAULT) -> Any:
        """The newest value of a variable (TCA 7.7: GetVar); if never set *default*, or
        VariableNotSet is raised.
        """
        check("get_variable()", checks.VARIABLE, variable=variable)
        connection = self._declare(variable)
        asked = connection.answered(
            headers.GetVariable(0, variable.name), f"variable '{variable.name}'"
        )
        if body := asked.answers[-1][1]:
            return variable.decode_data(body)
        if default is _NO_DEFAULT:
            raise VariableNotSet(
                f"variable '{variable.name}' was never set: set it first, watch it, or give a default"
            )
        return default

    @overload
    def swap_variable(self, variable: Variable[D], value: D) -> D | None: ...
    @overload
    def swap_variable(self, variable: Variable[D], value: D, default: X) -> D | X: ...
    def swap_variable(self, variable: Variable[D], value: D, default: Any = None) -> Any:
        """Set a variable and return its value before, in one step (TCA 7.7: GetSetVar); *default*
        if it had none.
        """
        check("swap_variable()", checks.VARIABLE, variable=variable)
        body = variable.encode_data(value)
        connection = self._declare(variable)
        header = headers.SetVariable(0, variable.name, self._origin, swap=True)
        asked = connection.answered(header, f"exchanging variable '{variable.name}'", body)
        before = asked.answers[-1][1]
        return variable.decode_data(before) if before else default

    # --- resources --------------------------------------------------------------------------------

    def lock(
        self,
        resource: str,
        module: str | None = None,
        *,
        timeout: float | None = None,
        priority: int = 0,
    ) -> Claim:
        """Let nobody into a resource, this module neither; returns when nobody is in it (TCA 8.5:
        LockResource).

        ::

            with task.lock("sensors"):
                ...

        ``release()`` or the end of a ``with`` block releases it, and raises LockLost if it was
        taken away before. Otherwise it ends with the task being handled, or with this module.
        *module* is needed where several modules have a resource of that name. It waits among the
        resource's messages by *priority*.

        Raises Timeout after *timeout* seconds (0: unless it is free now), Deadlock if it would wait
        for itself, Refused if there is no such resource.
        """
        return self._claim(resource, module, timeout, priority, reserve=False)

    def reserve(
        self,
        resource: str,
        module: str | None = None,
        *,
        timeout: float | None = None,
        priority: int = 0,
    ) -> Claim:
        """Let in only what this module sends (TCA 8.5: ReserveResource); otherwise like
        ``lock``.
        """
        return self._claim(resource, module, timeout, priority, reserve=True)

    def unlock(self, resource: str, module: str | None = None) -> bool:
        """Take a lock or reservation away from its holder; whether there was one (TCA 8.5:
        ``unlock``). For operators. The holder is told: its handler or client with LockLost, else
        its task with the failure "lock lost".
        """
        check("unlock()", checks.NAME, resource=resource)
        check("unlock()", checks.NAME_OR_NONE, module=module)
        header = headers.Unlock(0, resource, module or "", self._origin)
        return bool(self._connection().call(header, f"unlocking resource '{resource}'"))

    def go_on(self) -> bool:
        """Let tasks start again after a restart of central, whoever has not come back yet; whether
        they were held back. For operators: see ``tca central --resume hold``.
        """
        return bool(self._connection().call(headers.GoOn(0), "letting tasks start again"))

    # --- attachments ------------------------------------------------------------------------------

    def detach(self, number: int) -> bool:
        """Take away the exception handler or wiretap of that *number* (``tca attached``) whoever
        wants it, or end that monitor; whether it was still there. For operators. Raises Refused if
        there has never been that number, or it is a task.
        """
        check("detach()", checks.NUMBER, number=number)
        header = headers.Remove(0, number, for_all=True, origin=self._origin)
        return bool(self._connection().call(header, f"detaching {number}"))

    def _claim(
        self,
        resource: str,
        module: str | None,
        timeout: float | None,
        priority: int,
        *,
        reserve: bool,
    ) -> Claim:
        call = "reserve()" if reserve else "lock()"
        check(call, checks.NAME, resource=resource)
        check(call, checks.NAME_OR_NONE, module=module)
        check(call, checks.PRIORITY, priority=priority)
        brief = is_brief(call, timeout)
        check(call, checks.SECONDS, timeout=timeout or 0)
        seconds = -1 if timeout is None else timeout
        header = headers.Lock(
            0,
            resource,
            module or "",
            reserve,
            self._origin,
            seconds,
            priority,
            blocking=True,
            brief=brief,
        )
        claim = Claim(self._connection(), header)
        claim.wait(timeout)
        return claim

    # --- directory --------------------------------------------------------------------------------

    def _ask_central(self, topic: Topic, within: float | None = ACKNOWLEDGED_WITHIN) -> bytes:
        asked = self._connection().answered(
            headers.Ask(0, topic), f"the question for {topic}", within=within
        )
        return asked.answers[-1][1]

    def modules(self) -> list[ModuleInfo]:
        """The modules that are connected, this one too."""
        return msgspec.msgpack.decode(self._ask_central("modules"), type=list[ModuleInfo])

    def messages(self) -> list[MessageInfo]:
        """The messages that are declared, with their formats and handlers."""
        return self._messages()

    def _messages(self, within: float = ACKNOWLEDGED_WITHIN) -> list[MessageInfo]:
        return msgspec.msgpack.decode(self._ask_central("messages", within), type=list[MessageInfo])

    def handlers(self, message: Message[Any, Any]) -> list[HandlerInfo]:
        """The handlers of a message, newest first. The newest gets all messages, unless several
        share a pool.
        """
        self._declare(message)
        return next(list(one.handled_by) for one in self._messages() if one.name == message.name)

    def declared(self, name: str) -> Any:
        """The message or variable of that name, as some module has declared it, with plain values
        as data and replies. Raises NotDeclared if there is none, MisuseError for a monitor.
        """
        check("declared()", checks.TEXT, name=name)
        known = {message.name: message for message in self._messages()}
        if (found := known.get(name)) is None:
            advice = did_you_mean(name, known) or "see 'tca messages', and start who declares it"
            raise NotDeclared(f"nobody has declared a message '{name}': {advice}")
        kind: type[Any] | None = _KINDS.get(found.message_class)
        if kind is None:
            raise MisuseError(
                f"'{name}' is a {found.message_class}: declare it in Python to have it watch"
            )
        answers: dict[Any, str] = {Command: "result", Query: "reply", MultiQuery: "reply"}
        options: dict[str, Any] = (
            {answers[kind]: PlainFormat(found.reply)} if kind in answers else {}
        )
        if issubclass(kind, TaskMessage):
            options["life_cycle"] = read_life_cycle(found.life_cycle)
            options["progress"] = PlainFormat(found.progress) if found.progress else None
        message: Message[Any, Any] = kind(name, PlainFormat(found.data), **options)
        return message

    def wait_until_handled(
        self, *messages: Message[Any, Any], timeout: float | None = None
    ) -> None:
        """Wait until each of the messages is handled. Raises Timeout, naming those that nobody
        handles.
        """
        check("wait_until_handled()", checks.TIMEOUT, timeout=timeout)
        try:
            left = self._declare_within(timeout, *messages)
        except Timeout:
            why = self._connection().silence or "central had not heard of them yet"
            raise Timeout(
                f"the wait for handlers was not over within {timeout:g} s: {why}"
            ) from None
        connection = self._declare(*messages)
        wanted = headers.WaitUntilHandled(
            0, [message.name for message in messages], [], self._origin
        )
        request = connection.request(wanted, wants_answer=True, is_awaited=True)
        if not connection.wait(request, left, "the wait for handlers"):
            connection.abandon(request)
            if silence := connection.silence:
                raise Timeout(f"the wait for handlers was not over within {timeout:g} s: {silence}")
            raise Timeout(
                f"{self._unhandled(messages, timeout)}; start the module that does, see 'tca messages'"
            )

    def _unhandled(self, messages: Iterable[Message[Any, Any]], timeout: float | None) -> str:
        named = {message.name: message.title for message in messages}
        try:
            known = self._messages(_WHY_WITHIN)
        except Timeout:
            return f"not all handled within {timeout:g} s: {', '.join(named.values())}"
        handled = {one.name for one in known if any(handler.capacity for handler in one.handled_by)}
        missing = [name for name in named if name not in handled]
        return f"not handled within {timeout:g} s: {', '.join(named[name] for name in missing)}"


_DECLARED: list[type[Message[Any, Any]]] = [*EXECUTED, Variable, ExceptionHandler]
_KINDS: dict[str, Any] = {str(kind.message_class): kind for kind in _DECLARED}
