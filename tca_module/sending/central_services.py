"""What central keeps for all, and who is there: variables, the modules, the handlers of a message."""

from collections.abc import Iterable
from difflib import get_close_matches
from typing import Any, TypeVar, overload

import msgspec

from tca_module import checks
from tca_module.checks import check, is_brief
from tca_module.errors import MisuseError, NotDeclared, Timeout, VariableNotSet
from tca_module.link.connection import ACKNOWLEDGED_WITHIN, Connection
from tca_module.sending.claim import Claim
from tca_module.sending.directory import HandlerInfo, ModuleInfo, handlers_of, modules_of
from tca_wire.messages.controls import ExceptionHandler, Monitor
from tca_wire.messages.declarations import Broadcast, Command, D, Goal, Inform, Message, MultiQuery, Query, Variable
from tca_wire.packets.headers import Ask, GetVariable, Lock, Remove, SetVariable, ToCentral, Unlock, WaitUntilHandled
from tca_wire.text.plain_data import PlainFormat

X = TypeVar("X")

_NO_DEFAULT: Any = object()
_DECLARED_WITHIN = 0.2  # seconds that central may take to know a message, where the sender would wait for less
_WHY_WITHIN = 0.2  # seconds that central may take to say who is missing, when the time is over


class CentralServices:
    """The part of a sender that asks central itself and no module."""

    _origin: int

    def _connection(self) -> Connection:
        """The connection of the calling thread."""
        raise NotImplementedError

    def _declare(self, *messages: Message[Any, Any], within: float = ACKNOWLEDGED_WITHIN) -> Connection:
        """The connection, on which central knows the messages, and what monitors among them ask and send."""
        parts = [part for one in messages if isinstance(one, Monitor) for part in one.parts if part is not None]
        self._connection().declare(*parts, *messages, within=within)
        return self._connection()  # which may have lost its central meanwhile

    def _declare_within(self, timeout: float | None, *messages: Message[Any, Any]) -> float | None:
        """The same within the *timeout* of the wait that follows; what is left of that. Raises Timeout."""
        if timeout is None or timeout >= ACKNOWLEDGED_WITHIN:
            return timeout
        began = self._connection().now()
        connection = self._declare(*messages, within=max(timeout, _DECLARED_WITHIN))
        return max(0.0, timeout - (connection.now() - began))

    # --- variables -------------------------------------------------------------------------------------------------

    def set_variable(self, variable: Variable[D], value: D, *, wait: bool = True) -> None:
        """Give a variable a new value, for all who get or watch it (TCA 7.7: SetVar).

        Returns when central has it: whoever gets the variable from then on gets this value or a newer one. With *wait*
        False returns at once: for values that come many times a second; one may be lost when central is away.
        Raises BadData if *value* does not fit, Refused if the values of all variables would be too large.
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
        """The newest value of a variable, whether or not who set it is still there (TCA 7.7: GetVar).

        Of one that was never set: *default*; without a default raises VariableNotSet.
        """
        check("get_variable()", checks.VARIABLE, variable=variable)
        connection = self._declare(variable)
        body = _ask(connection, GetVariable(0, variable.name), f"variable '{variable.name}'")
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
        """Give a variable a new value and return the one before, in one step (TCA 7.7: GetSetVar).

        Of those who swap at the same time each gets what another has set. *default* if it was never set before.
        """
        check("swap_variable()", checks.VARIABLE, variable=variable)
        body = variable.encode_data(value)
        connection = self._declare(variable)
        header = SetVariable(0, variable.name, self._origin, swap=True)
        before = _ask(connection, header, f"exchanging variable '{variable.name}'", body)
        return variable.decode_data(before) if before else default

    # --- resources -------------------------------------------------------------------------------------------------

    def lock(
        self, resource: str, module: str | None = None, *, timeout: float | None = None, priority: int = 0
    ) -> Claim:
        """Let nobody into a resource, this module neither; returns when nobody is in it (TCA 8.5: LockResource).

        ::

            with task.lock("sensors"):
                ...

        It is released by ``release()`` or at the end of a ``with`` block, which raise LockLost if it was taken away
        before; ``held`` of what this returns says whether one has it still. Else it is released when the task being
        handled has ended with all under it, and in any case when this module is gone. *module* is needed where several
        have a resource of that name. It waits in the queue of the resource's messages, where *priority* counts. Raises
        Timeout if it takes longer than *timeout* seconds (0: unless it is free now), Deadlock if it would wait for
        itself, Refused if there is no such resource.
        """
        return self._claim(resource, module, timeout, priority, reserve=False)

    def reserve(
        self, resource: str, module: str | None = None, *, timeout: float | None = None, priority: int = 0
    ) -> Claim:
        """Let nothing into a resource but what this module sends (TCA 8.5: ReserveResource); else as ``lock``."""
        return self._claim(resource, module, timeout, priority, reserve=True)

    def unlock(self, resource: str, module: str | None = None) -> bool:
        """Take a lock or reservation of a resource from whoever has it; whether anybody had it.

        For operators: a handler releases what it has itself. Who had it is told: LockLost where a handler or client
        counts on it, else the failure "lock lost" of the task that keeps it (TCA 8.5: ``unlock``).
        """
        check("unlock()", checks.NAME, resource=resource)
        check("unlock()", checks.NAME_OR_NONE, module=module)
        header = Unlock(0, resource, module or "", self._origin)
        return bool(self._connection().call(header, f"unlocking resource '{resource}'"))

    # --- what is attached ------------------------------------------------------------------------------------------

    def detach(self, number: int) -> bool:
        """Take away the exception handler or wiretap of that *number* (``tca attached``), whoever wants it, or end that
        monitor; whether it was there still. What it has sent comes to its own end.

        For operators, where the module that attached it has left: a module removes its own with
        ``AttachmentRef.remove``, and ends its monitors with ``MonitorRef.end``. Raises Refused if there has never been
        that number, or it is a task.
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

    # --- who is there ----------------------------------------------------------------------------------------------

    def modules(self) -> list[ModuleInfo]:
        """The modules that are connected, this one too."""
        return modules_of(_ask(self._connection(), Ask(0, "modules"), "the question for modules"))

    def handlers(self, message: Message[Any, Any]) -> list[HandlerInfo]:
        """Who handles a message, the newest handler first: of several that share no pool it gets all."""
        connection = self._declare(message)
        return handlers_of(_ask(connection, Ask(0, "messages"), "the question for messages"))[message.name]

    def declared(self, name: str) -> Message[Any, Any]:
        """A message, or variable, that some module has declared, by its name: for programs that send what they are
        told to. Its data and replies are plain values: dicts, lists, texts, numbers, None.

        Raises NotDeclared if there is none, MisuseError for a monitor, which has more to it than its name.
        """
        check("declared()", checks.TEXT, name=name)
        known = msgspec.msgpack.decode(_ask(self._connection(), Ask(0, "messages"), "the question for messages"))
        found = next((message for message in known if message["message"] == name), None)
        if found is None:
            nearest = get_close_matches(name, [message["message"] for message in known], n=1)
            advice = f"did you mean '{nearest[0]}'?" if nearest else "see 'tca messages', and start who declares it"
            raise NotDeclared(f"nobody has declared a message '{name}': {advice}")
        kind: type[Any] | None = _KINDS.get(found["class"])
        if kind is None:
            raise MisuseError(f"'{name}' is a {found['class']}: declare it in Python to have it watch")
        answer = {Command: "result", Query: "reply", MultiQuery: "reply"}.get(kind)
        options = {answer: PlainFormat(found["reply"])} if answer else {}
        message: Message[Any, Any] = kind(name, PlainFormat(found["data"]), **options)
        return message

    def wait_until_handled(self, *messages: Message[Any, Any], timeout: float | None = None) -> None:
        """Wait until somebody handles each of the messages, all at the same time; *timeout* in seconds.

        Raises Timeout, naming those that nobody handles. A handler may leave again at any time; a goal, command or
        query then waits for the next.
        """
        check("wait_until_handled()", checks.TIMEOUT, timeout=timeout)
        try:
            left = self._declare_within(timeout, *messages)
        except Timeout:
            why = self._connection().silence or "central had not heard of them yet"
            raise Timeout(f"the wait for handlers was not over within {timeout:g} s: {why}") from None
        connection = self._declare(*messages)
        request = connection.request(wait_until_handled(messages), wants_answer=True, is_awaited=True)
        if not connection.wait(request, left, "the wait for handlers"):
            connection.abandon(request)
            if silence := connection.silence:
                raise Timeout(f"the wait for handlers was not over within {timeout:g} s: {silence}")
            raise Timeout(f"{self._unhandled(messages, timeout)}; start the module that does, see 'tca messages'")

    def _unhandled(self, messages: Iterable[Message[Any, Any]], timeout: float | None) -> str:
        named = {message.name: f"{message.message_class} '{message.name}'" for message in messages}
        try:
            answer = _ask(self._connection(), Ask(0, "messages"), "the question for messages", within=_WHY_WITHIN)
        except Timeout:
            return (
                f"not all handled within {timeout:g} s: {', '.join(named.values())}; central did not say at once which"
            )
        known = handlers_of(answer)
        missing = [name for name in named if not any(handler.capacity for handler in known.get(name, ()))]
        return f"not handled within {timeout:g} s: {', '.join(named[name] for name in missing)}"


_KINDS: dict[str, Any] = {
    str(kind.message_class): kind
    for kind in (Inform, Query, Broadcast, MultiQuery, Goal, Command, Variable, ExceptionHandler)
}


def wait_until_handled(messages: Iterable[Message[Any, Any]], promised: Iterable[str] = ()) -> WaitUntilHandled:
    """The request that is answered when each of the messages is handled; central must know them. *promised*: what the
    sender handles from then on.
    """
    return WaitUntilHandled(0, [message.name for message in messages], list(promised))


def _ask(
    connection: Connection, header: ToCentral, what: str, body: bytes = b"", within: float = ACKNOWLEDGED_WITHIN
) -> bytes:
    """The body of central's answer, which waits for nobody else."""
    request = connection.request(header, body, wants_answer=True, is_awaited=True)
    if not connection.wait(request, within, what):
        connection.abandon(request)
        raise Timeout(f"{what} was not answered within {within:g} s, though central is alive: it is overloaded")
    return request.answers[-1][1]
