"""The requests of a Sender to central itself: variables, locks and the directory."""

from collections import deque
from collections.abc import Callable, Iterable, Sequence
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
from tca_module.session.request import Request
from tca_wire.life_cycles import read_life_cycle
from tca_wire.messages.controls import ExceptionHandler
from tca_wire.messages.declarations import (
    Command,
    D,
    Message,
    MultiQuery,
    Query,
    Retry,
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
_DECLARED_WITHIN = 0.2  # seconds that a declaration may take, even if the caller's timeout is less
HANDLERS_WAIT = "the wait for handlers"  # in errors
_WHY_WITHIN = 0.2  # seconds for central to name the missing handlers after a timeout

SentTasks = deque[tuple[float, str, TaskId]]
"""Tasks that were sent: time, message name, id."""

MOST_SENT = 10_000
"""The number of tasks that a Sender remembers to have sent."""


class CentralServices:
    """The base of a Sender: its place in the task tree, and its requests to central itself."""

    def __init__(
        self,
        parent: TaskId = ROOT,
        origin: int = 0,
        *,
        is_shared: bool = False,
        connection: Callable[[], Connection] | None = None,
    ) -> None:
        # Returns the calling thread's connection. If None, a subclass overrides _connection().
        self._given_connection = connection
        self._parent = parent
        self._origin = origin
        # Whether other Senders may send under the same parent. Under the root, others always may.
        self._is_shared = is_shared or parent == ROOT

    @cached_property
    def _ordering(self) -> SiblingOrder:
        """The order of the sent tasks, created at the first use: most handlers send no tasks."""
        return SiblingOrder(is_shared=self._is_shared)

    @cached_property
    def _sent(self) -> SentTasks:
        """The newest tasks that this Sender has sent."""
        return deque(maxlen=MOST_SENT)

    def _connection(self) -> Connection:
        """Return the connection of the calling thread."""
        assert self._given_connection is not None
        return self._given_connection()

    def _declare(
        self, *messages: Message[Any, Any], within: float = ACKNOWLEDGED_WITHIN
    ) -> Connection:
        """Declare *messages* and those that they need. Return the connection."""
        connection = self._connection()
        if all(map(connection.has_declared, messages)):
            return connection
        connection.declare(*messages, within=within)
        return self._connection()  # once more: central may have been restarted in the meantime

    def _declare_within(self, timeout: float | None, *messages: Message[Any, Any]) -> float | None:
        """Declare messages within a *timeout*; return the seconds that are left of the timeout.

        With None, or with 30 s or more, nothing is declared: the caller does that. Raises Timeout.
        """
        if timeout is None or timeout >= ACKNOWLEDGED_WITHIN:
            return timeout
        started = self._connection().now()
        connection = self._declare(*messages, within=max(timeout, _DECLARED_WITHIN))
        return max(0.0, timeout - (connection.now() - started))

    # --- variables --------------------------------------------------------------------------------

    def set_variable(self, variable: Variable[D], value: D, *, wait: bool = True) -> None:
        """Set a variable (TCA 7.7: SetVar).

        Args:
            variable: the Variable.
            value: the new value.
            wait: wait until central has the value. With False, the call returns at once. That suits
                values that change many times a second. A value may then be lost while central is
                away. Default: True.

        Raises:
            BadData: *value* does not fit the variable's type.
            Refused: the values of all variables together would be too large.
            CentralLost: central does not answer.

        Example::

            task.set_variable(BATTERY_LEVEL, 0.8)
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
        """Return the newest value of a variable (TCA 7.7: GetVar).

        Args:
            variable: the Variable.
            default: the value to return if the variable was never set. Without it, VariableNotSet
                is raised.

        Returns:
            The value, or *default*.

        Raises:
            VariableNotSet: the variable was never set, and there is no *default*.
            CentralLost: central does not answer.

        Example::

            level = task.get_variable(BATTERY_LEVEL, default=1.0)
        """
        check("get_variable()", checks.VARIABLE, variable=variable)
        connection = self._declare(variable)
        request = connection.ask_central(
            headers.GetVariable(0, variable.name), f"variable '{variable.name}'"
        )
        if body := request.answers[-1][1]:
            return variable.decode_data(body)
        if default is _NO_DEFAULT:
            advice = "set it first, handle it to watch it, or give a default"
            raise VariableNotSet(f"variable '{variable.name}' was never set: {advice}")
        return default

    @overload
    def swap_variable(self, variable: Variable[D], value: D) -> D | None: ...
    @overload
    def swap_variable(self, variable: Variable[D], value: D, default: X) -> D | X: ...
    def swap_variable(self, variable: Variable[D], value: D, default: Any = None) -> Any:
        """Set a variable and return its previous value, in one step (TCA 7.7: GetSetVar).

        Args:
            variable: the Variable.
            value: the new value.
            default: the value to return if the variable was never set. Default: None.

        Returns:
            The previous value, or *default*.

        Raises:
            BadData: *value* does not fit the variable's type.
            Refused: the values of all variables together would be too large.
            CentralLost: central does not answer.
        """
        check("swap_variable()", checks.VARIABLE, variable=variable)
        body = variable.encode_data(value)
        connection = self._declare(variable)
        header = headers.SetVariable(0, variable.name, self._origin, swap=True)
        request = connection.ask_central(header, f"exchanging variable '{variable.name}'", body)
        previous = request.answers[-1][1]
        return variable.decode_data(previous) if previous else default

    # --- resources --------------------------------------------------------------------------------

    def lock(
        self,
        resource: str,
        module: str | None = None,
        *,
        timeout: float | None = None,
        priority: int = 0,
    ) -> Claim:
        """Lock a resource: it handles no messages, not even this module's (TCA 8.5: LockResource).

        The call returns when the resource is idle. It waits in the resource's queue by *priority*.
        The end of the ``with`` block, or ``release()``, releases the lock. Otherwise the lock ends
        when the caller's task and all tasks under it have ended, or when the module leaves.

        Args:
            resource: the resource's name.
            module: the name of the resource's module. Default: None, which suffices if one module
                has a resource of that name.
            timeout: the most seconds to wait; 0 succeeds only if the resource is free now. Default:
                None, no bound.
            priority: -1,000,000 to 1,000,000; the highest is first in the resource's queue.
                Default: 0.

        Returns:
            The Claim, for a ``with`` block. The end of the block raises LockLost if the lock was
            taken away before.

        Raises:
            Timeout: the lock was not granted in time.
            Deadlock: the wait would never end.
            Refused: there is no such resource.
            TaskKilled: in a handler: its task was killed.
            Stopped: in a handler: its module ends.

        Example::

            with task.lock("camera", timeout=5.0) as claim:
                scan()
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
        """Reserve a resource: it handles only messages of this module (TCA 8.5: ReserveResource).

        Messages that central sends on behalf of this module count as its own. The reservation waits
        in the queue and ends as a lock does, see ``lock``.

        Args:
            resource: the resource's name.
            module: the name of the resource's module. Default: None, which suffices if one module
                has a resource of that name.
            timeout: the most seconds to wait; 0 succeeds only if the resource is free now. Default:
                None, no bound.
            priority: -1,000,000 to 1,000,000; the highest is first in the resource's queue.
                Default: 0.

        Returns:
            The Claim, for a ``with`` block. The end of the block raises LockLost if the reservation
            was taken away before.

        Raises:
            Timeout: the reservation was not granted in time.
            Deadlock: the wait would never end.
            Refused: there is no such resource.
            TaskKilled: in a handler: its task was killed.
            Stopped: in a handler: its module ends.
        """
        return self._claim(resource, module, timeout, priority, reserve=True)

    def unlock(self, resource: str, module: str | None = None) -> bool:
        """Take a lock or reservation away from its holder (TCA 8.5: ``unlock``). For operators.

        The holder is notified: the handler or client with the lock gets LockLost. If that handler
        has returned, its task gets the failure "lock lost".

        Args:
            resource: the resource's name.
            module: the name of the resource's module. Default: None, which suffices if one module
                has a resource of that name.

        Returns:
            True if the resource was locked or reserved.

        Raises:
            Refused: there is no such resource.
        """
        check("unlock()", checks.NAME, resource=resource)
        check("unlock()", checks.NAME_OR_NONE, module=module)
        header = headers.Unlock(0, resource, module or "", self._origin)
        return bool(self._connection().call(header, f"unlocking resource '{resource}'"))

    def go_on(self) -> bool:
        """Allow tasks to start after a restart of central, before all modules are back.

        For operators. See ``tca central --resume hold``.

        Returns:
            True if central held tasks back.
        """
        return bool(self._connection().call(headers.GoOn(0), "letting tasks start again"))

    def end_central(self, *, keep: bool = False) -> None:
        """End central, for everyone. For operators. This sender's connection ends, too.

        Args:
            keep: whether the run continues at central's next start. Modules then wait for it.
                Default: False, which ends the run.

        Raises:
            Refused: central stores no inputs, so that the run can't be kept; or the permissions
                do not allow it.
            CentralLost: central does not answer.

        Example::

            with connect("maintenance") as user:
                user.end_central(keep=True)
        """
        check("end_central()", checks.FLAG, keep=keep)
        self._connection().call(headers.EndCentral(0, keep), "ending central")

    # --- attachments ------------------------------------------------------------------------------

    def detach(self, number: int) -> bool:
        """Remove an exception handler or wiretap, or end a monitor, by its number. For operators.

        An exception handler or wiretap is removed for all modules that attached it. ``tca
        attached`` lists the numbers.

        Args:
            number: the number, 0 or more.

        Returns:
            True if there was still something to remove or end.

        Raises:
            Refused: the number was never used, or is the number of a task.
        """
        check("detach()", checks.NUMBER, number=number)
        header = headers.Remove(0, number, for_all=True, origin=self._origin)
        return bool(self._connection().call(header, f"detaching {{{number}}}"))

    def _claim(
        self,
        resource: str,
        module: str | None,
        timeout: float | None,
        priority: int,
        *,
        reserve: bool,
    ) -> Claim:
        """Request a lock or reservation, and wait until it is granted."""
        claim = self._request_claim(resource, module, timeout, priority, reserve=reserve)
        claim.wait(timeout)
        return claim

    def _request_claim(
        self,
        resource: str,
        module: str | None,
        timeout: float | None,
        priority: int,
        *,
        reserve: bool,
        blocking: bool = True,
    ) -> Claim:
        """Request a lock or reservation. *blocking*: the handler waits for nothing else."""
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
            blocking=blocking,
            brief=brief,
        )
        return Claim(self._connection(), header)

    # --- directory --------------------------------------------------------------------------------

    def _ask_central(self, topic: Topic, within: float | None = ACKNOWLEDGED_WITHIN) -> bytes:
        """Return central's report on a topic, encoded."""
        request = self._connection().ask_central(
            headers.Ask(0, topic), f"the question for {topic}", within=within
        )
        return request.answers[-1][1]

    def modules(self) -> list[ModuleInfo]:
        """Return the connected modules, this one included.

        Example::

            print([one.name for one in user.modules()])
        """
        return msgspec.msgpack.decode(self._ask_central("modules"), type=list[ModuleInfo])

    def messages(self) -> list[MessageInfo]:
        """Return the declared messages, with their formats and handlers."""
        return self._messages()

    def _messages(self, within: float = ACKNOWLEDGED_WITHIN) -> list[MessageInfo]:
        return msgspec.msgpack.decode(self._ask_central("messages", within), type=list[MessageInfo])

    def handlers(self, message: Message[Any, Any]) -> list[HandlerInfo]:
        """Return the handlers of a message.

        The newest handler gets all messages, unless several share a pool.

        Args:
            message: a message of any class.

        Returns:
            The handlers, newest first.

        Raises:
            FormatRefused: other programs declare the message differently.
            CentralLost: central does not answer.

        Example::

            if not user.handlers(SAY):
                print("no module speaks")
        """
        self._declare(message)
        return next(
            list(known.handled_by) for known in self._messages() if known.name == message.name
        )

    def declared(self, name: str) -> Any:
        """Return a message or variable by name, as some module has declared it.

        Its data and replies are plain values (dicts, lists, numbers, texts), checked against the
        declared format.

        Args:
            name: the message's name.

        Returns:
            The message, ready to be sent.

        Raises:
            NotDeclared: no module has declared the name.
            MisuseError: the message is a monitor, which must be declared in Python.

        Example::

            walk = user.declared("walk")
            user.goal(walk, {"steps": 3})
        """
        check("declared()", checks.TEXT, name=name)
        known = {message.name: message for message in self._messages()}
        if (found := known.get(name)) is None:
            general = "see 'tca messages', and start the module that declares it"
            advice = did_you_mean(name, known) or general
            raise NotDeclared(f"no module has declared a message '{name}': {advice}")
        kind: type[Any] | None = _KINDS.get(found.message_class)
        if kind is None:
            advice = "declare it in Python to start it"
            raise MisuseError(f"'{name}' is a {found.message_class}: {advice}")
        answers: dict[Any, str] = {Command: "result", Query: "reply", MultiQuery: "reply"}
        options: dict[str, Any] = {}
        if kind in answers:
            options[answers[kind]] = PlainFormat(found.reply)
        if issubclass(kind, TaskMessage):
            options["life_cycle"] = read_life_cycle(found.life_cycle)
            options["progress"] = PlainFormat(found.progress) if found.progress else None
            options["retry"] = Retry.of_policy(found.retry) if found.retry is not None else None
        message: Message[Any, Any] = kind(name, PlainFormat(found.data), **options)
        return message

    def wait_until_handled(
        self, *messages: Message[Any, Any], timeout: float | None = None
    ) -> None:
        """Wait until each of the messages has a handler.

        Args:
            messages: one or more messages.
            timeout: the most seconds to wait. Default: None, no bound.

        Raises:
            Timeout: some message has no handler in time; the text names these messages.
            Deadlock: in a handler: the wait would never end.
            CentralLost: central does not answer.

        Example::

            user.wait_until_handled(WALK, SAY, timeout=10)
        """
        connection, request, left = self._request_handled(messages, timeout)
        connection.wait(request, left, HANDLERS_WAIT)
        self._check_handled(request, messages, timeout)

    def _request_handled(
        self, messages: Sequence[Message[Any, Any]], timeout: float | None
    ) -> tuple[Connection, Request, float | None]:
        """Ask central to report when the messages have handlers.

        Returns the request, and the seconds that are left of the timeout. Raises Timeout.
        """
        check("wait_until_handled()", checks.TIMEOUT, timeout=timeout)
        try:
            left = self._declare_within(timeout, *messages)
        except Timeout:
            why = self._connection().why_silent or "central did not know these messages yet"
            raise Timeout(f"{HANDLERS_WAIT} was not over within {timeout:g} s: {why}") from None
        connection = self._declare(*messages)
        names = [message.name for message in messages]
        wanted = headers.WaitUntilHandled(0, names, [], self._origin)
        return connection, connection.request(wanted, wants_answer=True, is_awaited=True), left

    def _check_handled(
        self, request: Request, messages: Sequence[Message[Any, Any]], timeout: float | None
    ) -> None:
        """Raise Timeout if some message has no handler yet."""
        if not request.is_over:
            connection = self._connection()
            connection.abandon(request)
            if why := connection.why_silent:
                raise Timeout(f"{HANDLERS_WAIT} was not over within {timeout:g} s: {why}")
            advice = "start the module that handles them, see 'tca messages'"
            raise Timeout(f"{self._unhandled(messages, timeout)}; {advice}")

    def _unhandled(self, messages: Iterable[Message[Any, Any]], timeout: float | None) -> str:
        """Describe which of the messages have no handler, for the Timeout."""
        named = {message.name: message.title for message in messages}
        try:
            known = self._messages(_WHY_WITHIN)
        except Timeout:
            return f"not all handled within {timeout:g} s: {', '.join(named.values())}"
        handled = {info.name for info in known if any(one.capacity for one in info.handled_by)}
        missing = [name for name in named if name not in handled]
        return f"not handled within {timeout:g} s: {', '.join(named[name] for name in missing)}"


_DECLARED: list[type[Message[Any, Any]]] = [*EXECUTED, Variable, ExceptionHandler]
_KINDS: dict[str, Any] = {str(kind.message_class): kind for kind in _DECLARED}
"""Class in a report -> the Python class of the messages that ``declared`` can return."""
