"""AsyncSender: the calls of a Sender as coroutines, for the user's own event loop."""
# ruff: noqa: SLF001, ASYNC109 - it does the work of a Sender: its calls have the same options

import asyncio
from collections.abc import Callable, Coroutine
from contextlib import nullcontext, suppress
from functools import partial
from typing import Any, Concatenate, ParamSpec, Self

from tca_module.asynchronous.async_tasks import AsyncSentTask, AsyncTaskRef, streamed
from tca_module.asynchronous.forwarding import (
    Forwarding,
    OnlyAsync,
    RunThere,
    WaitingIn,
    forward,
    forwarded,
    settle,
)
from tca_module.checks import checked_call
from tca_module.errors import Refused, TcaError, Timeout
from tca_module.link.connection import ACKNOWLEDGED_WITHIN
from tca_module.sending.central_services import HANDLERS_WAIT
from tca_module.sending.claim import Claim
from tca_module.sending.replies import QUERY_TIMEOUT
from tca_module.sending.sender import LONGEST_PAUSE, SHORTEST_PAUSE, Sender
from tca_module.sending.task_ref import SentTask, TaskRef
from tca_module.session.sent_tasks import SentId
from tca_wire.messages.declarations import Broadcast, Inform, Message, R
from tca_wire.vocabulary import Refusal

P = ParamSpec("P")


class AsyncClaim(OnlyAsync):
    """A lock or reservation that is held in an ``async with`` block."""

    _claim: Any = None  # the Claim, once it is granted

    def __init__(
        self, sender: "AsyncSender", resource: str, module: str | None, *options: Any, reserve: bool
    ) -> None:
        self._sender = sender
        self._turn = sender._turns.setdefault((resource, module), asyncio.Lock())
        claim: Any = _claim  # mypy does not count the arguments of a partial with *options
        self._claiming = partial(claim, self._turn, resource, module, *options, reserve=reserve)

    def __repr__(self) -> str:
        return repr(self._claim) if self._claim else "an async claim that is not held"

    async def __aenter__(self) -> Self:
        self._claim = await self._sender._run(
            self._claiming(self._sender._blocking), lambda claim: _leave(claim, self._turn, None)
        )
        return self

    async def __aexit__(self, _: object, error: BaseException | None, __: object) -> None:
        with nullcontext() if error is None else suppress(TcaError):  # else *error* is raised
            # Shielded, so that a second cancellation does not leave the resource locked.
            await asyncio.shield(
                self._sender.call(lambda _: _leave(self._claim, self._turn, error))
            )

    @property
    def held(self) -> bool:
        """Whether the claim still holds, as far as this program knows. Never waits."""
        claim = self._claim
        return bool(claim) and not (claim._is_released or claim._request.why_lock_lost)


def _sent(
    method: Callable[Concatenate[Any, P], SentTask[R]],
) -> Callable[Concatenate[Any, P], Coroutine[Any, Any, AsyncSentTask[R]]]:
    """Return a method that sends a task, as a coroutine method that awaits its acceptance."""

    def undo(sent: SentTask[Any]) -> None:
        sent.kill("its sender was cancelled")

    async def send(sender: Sender, *args: Any, **options: Any) -> SentTask[Any]:
        sent: SentTask[Any] = method(sender, *args, **options)
        if isinstance(sent._task_id, SentId):
            request, connection = sent._task_id.request, sent._connection()
            try:
                await settle(connection, request, None, request.what)
            except asyncio.CancelledError:
                if request.accepted is not None:  # too late to give up the request
                    undo(sent)
                raise
            finally:
                connection.session.sends.discard(request)
        sent.id  # noqa: B018 - raises the error of the send
        return sent

    return forward(method, send, undo, AsyncSentTask)


def _found(
    method: Callable[Concatenate[Any, P], list[TaskRef]],
) -> Callable[Concatenate[Any, P], Coroutine[Any, Any, list[AsyncTaskRef]]]:
    """Return a method that finds tasks, as a coroutine method."""

    def convert(run: RunThere, found: list[TaskRef]) -> list[AsyncTaskRef]:
        return [AsyncTaskRef(run, task) for task in found]

    return forward(method, convert=convert)


@checked_call
async def _query(
    sender: Sender,
    message: Any,
    data: Any = None,
    *,
    timeout: float | None = QUERY_TIMEOUT,
    priority: int = 0,
) -> Any:
    pending, left = sender._query_within(message, data, timeout, priority, blocking=False)
    await settle(pending.connection, pending.request, left, message.title)
    return pending.receive_within(0, timeout)


async def _multi_query(sender: Sender, message: Any, *args: Any, **options: Any) -> list[Any]:
    replies = sender.multi_query_send(message, *args, **options)
    await settle(replies.connection, replies.request, replies.seconds_left, message.title)
    return list(replies)


def _statement(kind: type[Message[Any, Any]]) -> Callable[..., Coroutine[Any, Any, None]]:
    @checked_call
    async def send(
        sender: Sender, message: Any, data: Any = None, *, wait: float | None = None
    ) -> None:
        loop, pause = asyncio.get_running_loop(), SHORTEST_PAUSE
        until = loop.time() + (wait or 0.0)
        while True:
            try:
                return sender._send_statement(message, kind, data, wait and 0.0)
            except Refused as error:
                left = until - loop.time()
                if error.refusal is not Refusal.OVERLOAD or left <= 0:
                    raise
            await asyncio.sleep(min(pause, left))
            pause = min(2 * pause, LONGEST_PAUSE)

    return send


async def _until_handled(
    sender: Sender, *messages: Message[Any, Any], timeout: float | None = None
) -> None:
    connection, request, left = sender._request_handled(messages, timeout)
    await settle(connection, request, left, HANDLERS_WAIT)
    sender._check_handled(request, messages, timeout)


class AsyncSender(Forwarding):
    """The calls of a ``Sender`` as coroutines: they never block the loop that awaits them.

    Several asyncio tasks, loops and threads may share it. Arguments, results and errors are those
    of the Sender's methods. Cancelling a call, such as by ``asyncio.timeout``, gives it up: a query
    is withdrawn, a lock is released, and a task that was just sent is killed.
    """

    def __init__(self, run: RunThere, blocking: Any) -> None:
        super().__init__(run, blocking)
        #: resource, module -> the turn to claim it, among the asyncio tasks of this sender
        self._turns: dict[tuple[str, str | None], asyncio.Lock] = {}

    goal = _sent(Sender.goal)
    command = _sent(Sender.command)
    query = WaitingIn(_query)(Sender.query)
    multi_query = WaitingIn(_multi_query)(Sender.multi_query)
    inform = WaitingIn(_statement(Inform))(Sender.inform)
    broadcast = WaitingIn(_statement(Broadcast))(Sender.broadcast)
    constrain = forwarded(Sender.constrain)

    get_variable = forwarded(Sender.get_variable)
    set_variable = forwarded(Sender.set_variable)
    swap_variable = forwarded(Sender.swap_variable)

    modules = forwarded(Sender.modules)
    messages = forwarded(Sender.messages)
    declared = forwarded(Sender.declared)
    wait_until_handled = WaitingIn(_until_handled)(Sender.wait_until_handled)
    cancel_all = forwarded(Sender.cancel_all)
    tasks = _found(Sender.tasks)
    observe = streamed(Sender.observe)

    async def task(self, task_id: int) -> AsyncTaskRef | None:
        """Find a task by its number. See ``Sender.task``.

        Args:
            task_id: the number, as in the journal.

        Returns:
            The task; None if it has ended and is not retained.
        """
        found = await self.call(lambda sender: sender.task(task_id))
        return None if found is None else AsyncTaskRef(self._run, found)

    def lock(
        self,
        resource: str,
        module: str | None = None,
        *,
        timeout: float | None = None,
        priority: int = 0,
    ) -> AsyncClaim:
        """Lock a resource while an ``async with`` block lasts. See ``Sender.lock``.

        Args:
            resource: the resource's name.
            module: its module. Default: None, the only module with a resource of that name.
            timeout: the most seconds to wait. Default: None, no bound.
            priority: the claim with the highest is first. Default: 0.

        Returns:
            The claim, which the ``async with`` block holds.

        Example::

            async with user.lock("camera", timeout=5.0) as claim:
                await scan()
        """
        return AsyncClaim(self, resource, module, timeout, priority, reserve=False)

    def reserve(
        self,
        resource: str,
        module: str | None = None,
        *,
        timeout: float | None = None,
        priority: int = 0,
    ) -> AsyncClaim:
        """Reserve a resource while an ``async with`` block lasts. See ``Sender.reserve``.

        Args:
            resource: the resource's name.
            module: its module. Default: None, the only module with a resource of that name.
            timeout: the most seconds to wait. Default: None, no bound.
            priority: the claim with the highest is first. Default: 0.

        Returns:
            The claim, which the ``async with`` block holds.
        """
        return AsyncClaim(self, resource, module, timeout, priority, reserve=True)


async def _claim(
    turn: asyncio.Lock,
    resource: str,
    module: str | None,
    timeout: float | None,
    priority: int,
    sender: Sender,
    *,
    reserve: bool,
) -> Claim:
    """Await a claim. Central knows one claim of this connection, so others wait for their turn."""
    now = asyncio.get_running_loop().time
    until = None if timeout is None else now() + timeout
    try:
        async with asyncio.timeout(timeout):
            await turn.acquire()
    except TimeoutError:
        text = f"resource '{resource}' was not granted within {timeout:g} s"
        raise Timeout(f"{text}: another asyncio task of this client has it") from None
    claim = None
    try:
        left = None if until is None else max(0.0, until - now())
        claim = sender._request_claim(
            resource, module, left, priority, reserve=reserve, blocking=False
        )
        # Central times the wait, too, so its answer comes soon after the timeout.
        within = None if left is None else left + ACKNOWLEDGED_WITHIN
        await settle(claim._connection, claim._request, within, repr(claim))
        claim.wait(timeout if claim._request.is_over else 0.0)
    except BaseException as error:
        turn.release()
        if claim is not None and claim._request.answers:  # too late to give up the request
            claim.__exit__(None, error, None)
        raise
    return claim


def _leave(claim: Claim, turn: asyncio.Lock, error: BaseException | None) -> None:
    """Release a claim as the end of its ``with`` block does, and let the next task claim it."""
    turn.release()
    claim.__exit__(None, error, None)
