"""Methods of blocking objects as coroutine methods, which run in the objects' own thread."""

import asyncio
from collections.abc import Callable, Coroutine
from functools import wraps
from typing import TYPE_CHECKING, Any, Concatenate, NoReturn, ParamSpec, Protocol, TypeVar

from tca_module.asynchronous.remote import Undo
from tca_module.checks import TIMEOUT, check
from tca_module.errors import MisuseError
from tca_module.following.stream import awaited
from tca_module.link.connection import Connection
from tca_module.session.request import Request

P = ParamSpec("P")
T = TypeVar("T")
B = TypeVar("B")


class RunThere(Protocol):
    """Runs a coroutine in the thread of a blocking object."""

    async def __call__(
        self, coroutine: Coroutine[Any, Any, Any], undo: Undo | None = None, /
    ) -> Any:
        """Return its result. If the caller is cancelled, *undo* gets the result."""


class OnlyAsync:
    """The base of objects for ``async with`` and ``async for``."""

    if not TYPE_CHECKING:  # a type checker finds the mistake itself

        def __enter__(self, *_: object) -> NoReturn:
            advice = "write 'async with' or 'async for'"
            raise MisuseError(f"{type(self).__name__} belongs to an event loop: {advice}")

        __exit__ = __iter__ = __await__ = __enter__


class Forwarding:
    """The base of an object on the user's loop that stands for a *blocking* object."""

    def __init__(self, run: RunThere, blocking: Any) -> None:
        self._run = run
        self._blocking = blocking

    def __repr__(self) -> str:
        return f"async {self._blocking!r}"

    async def call(self, function: Callable[[Any], T]) -> T:
        """Call a function with the blocking object, in that object's thread.

        This reaches the methods that have no coroutine here. The function should not wait for other
        modules, because all calls of this connection wait for it.

        Args:
            function: takes the blocking Client, Module, Task or TaskRef.

        Returns:
            The value that the function returns.

        Example::

            await user.call(lambda client: client.on_failure(COLLISION, RAISE_LEG))
        """

        async def call() -> T:
            return function(self._blocking)

        result: T = await self._run(call())
        return result


def forward(
    method: Callable[..., Any],
    waiting: Callable[..., Coroutine[Any, Any, Any]] | None = None,
    undo: Undo | None = None,
    convert: Callable[[RunThere, Any], Any] = lambda _, result: result,
) -> Callable[..., Any]:
    """Return a method as a coroutine method, without its type.

    Args:
        method: the method of the blocking object. It should not wait for other modules.
        waiting: a coroutine function that does the method's work, with the blocking object. It is
            for methods that do wait for others. Default: None.
        undo: is called with the result if the caller is cancelled. Default: None.
        convert: makes the result of the blocking result. Default: the same.
    """

    @wraps(method)
    async def call(self: Forwarding, /, *args: Any, **options: Any) -> Any:
        async def work() -> Any:
            if waiting is not None:
                return await waiting(self._blocking, *args, **options)
            return method(self._blocking, *args, **options)

        return convert(self._run, await self._run(work(), undo))

    return call


def forwarded(
    method: Callable[Concatenate[Any, P], T],
) -> Callable[Concatenate[Any, P], Coroutine[Any, Any, T]]:
    """Return a method, which should not wait for other modules, as a coroutine method."""
    return forward(method)


class WaitingIn:
    """Returns a method as a coroutine method whose work *waiting* does, see ``forward``.

    The method is the only argument of its call, because mypy then keeps all its overloads.
    """

    def __init__(self, waiting: Callable[..., Coroutine[Any, Any, Any]]) -> None:
        self._waiting = waiting

    def __call__(
        self, method: Callable[Concatenate[Any, P], T]
    ) -> Callable[Concatenate[Any, P], Coroutine[Any, Any, T]]:
        """Return the coroutine method."""
        return forward(method, self._waiting)


async def settle(
    connection: Connection, request: Request, within: float | None, what: object
) -> None:
    """Await the end of a request, at most *within* seconds.

    Raises the error of the request. The request is given up if this raises.
    """
    try:
        check(what, TIMEOUT, timeout=within)
        async with asyncio.timeout(within):
            await awaited(connection.wait_in_coroutine(request, what, lambda: request.is_over))
    except TimeoutError:
        return
    except BaseException:
        connection.abandon(request)
        raise
