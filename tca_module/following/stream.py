"""Changes of tasks as they come: iterated over, by plain code or by coroutines."""

import types
from collections.abc import AsyncIterator, Callable, Generator, Iterator
from typing import Any, Generic, Self, TypeVar

from tca_module.checks import TIMEOUT, check
from tca_module.errors import Timeout
from tca_module.following.observation import News, Observation, Wants

T = TypeVar("T")


class Stream(Iterator[T], AsyncIterator[T], Generic[T]):
    """Changes, or intermediate results, as they come. ``for`` waits for each; in async handlers
    ``async for`` does, and ``asyncio.timeout`` limits its wait.

    It ends with the task that it is about, or below which it observes. At most 10,000 wait to be
    read: the oldest beyond that are dropped, and counted in ``missed`` of the next.
    """

    def __init__(
        self,
        observation: Observation,
        give: Callable[[News], T],
        wants: Wants,
        what: str,
        timeout: float | None,
        *,
        is_owner: bool = False,
        first: News | None = None,
    ) -> None:
        """*first*: came before this was made. The end of its owner ends the observation."""
        check(what, TIMEOUT, timeout=timeout)
        self._observation = observation
        self._give = give
        self._what = what
        self._timeout = timeout
        self._is_owner = is_owner
        self._is_closed = False
        self._unread = observation.unread(wants)
        if first is not None:
            self._unread.begin_with(first)

    def __next__(self) -> T:
        if not self._has_next(self._timeout):
            raise StopIteration
        return self._give(self._unread.take())

    def receive(self, timeout: float | None = None) -> T | None:
        """The next one; None if none will come. Raises Timeout after so many seconds."""
        check(self._what, TIMEOUT, timeout=timeout)
        return self._give(self._unread.take()) if self._has_next(timeout) else None

    def _has_next(self, timeout: float | None) -> bool:
        """Wait for the next one; False if none will come."""
        if self._is_closed:
            return False
        if self._observation.wait(self._has_some, timeout):
            return True
        if self._observation.is_over:
            return False
        raise Timeout(f"{self._what} did not come within {timeout:g} s", can_wait=True)

    async def __anext__(self) -> T:
        if self._is_closed or not await awaited(self._observation.until(self._has_some)):
            raise StopAsyncIteration
        return self._give(self._unread.take())

    def _has_some(self) -> bool:
        return bool(self._unread)

    def arrived(self) -> list[T]:
        """Those that have come by now. Never waits. Raises what a wait does if none will ever
        come.
        """
        self._observation.catch_up()
        found = []
        while self._unread:
            found.append(self._give(self._unread.take()))
        if not found and not self._is_closed:
            self._observation.check()
        return found

    def close(self) -> None:
        """Want no more; twice does no harm. The end of a ``with`` block does it."""
        self._is_closed = True
        self._observation.forget(self._unread)
        if self._is_owner:
            self._observation.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


@types.coroutine
def awaited(waiting: Generator[Any, None, T]) -> Generator[Any, None, T]:
    """A wait of a connection's, for coroutines."""
    return (yield from waiting)
