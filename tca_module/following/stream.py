"""Changes of tasks as they arrive, to iterate over: in plain code or in a coroutine."""

import types
from collections.abc import AsyncIterator, Callable, Generator, Iterator
from typing import Any, Generic, Self, TypeVar

from tca_module.checks import TIMEOUT, check
from tca_module.errors import Timeout
from tca_module.following.observation import Observation, ObservedChange, Wants

T = TypeVar("T")


class Stream(Iterator[T], AsyncIterator[T], Generic[T]):
    """Changes or intermediate results, to iterate over as they arrive.

    ``for`` waits for the next element. In an async handler use ``async for``; ``asyncio.timeout``
    limits that wait. The stream of one task ends with the task. The stream of all tasks *below* a
    task ends with that task. At most 10,000 changes wait to be read. If there are more, the oldest
    are dropped, and ``missed`` of the same task's next change counts them.

    Example::

        with sent.changes(timeout=10) as changes:
            for change in changes:
                print(change.state)
    """

    def __init__(
        self,
        observation: Observation,
        convert: Callable[[ObservedChange], T],
        wants: Wants,
        what: str,
        timeout: float | None,
        *,
        is_owner: bool = False,
        first: ObservedChange | None = None,
    ) -> None:
        """*first*: a change that has arrived. *is_owner*: ``close`` also ends the observation."""
        check(what, TIMEOUT, timeout=timeout)
        self._observation = observation
        self._convert = convert
        self._what = what
        self._timeout = timeout
        self._is_owner = is_owner
        self._is_closed = False
        self._unread = observation.add_reader(wants)
        if first is not None:
            self._unread.start_with(first)

    def __next__(self) -> T:
        if not self._wait_for_next(self._timeout):
            raise StopIteration
        return self._convert(self._unread.pop())

    def receive(self, timeout: float | None = None) -> T | None:
        """Wait for the next element, and return it.

        Args:
            timeout: the most seconds to wait. Default: None, no bound.

        Returns:
            The element; None if the stream has ended.

        Raises:
            Timeout: no element arrived in time.
            CentralLost: central does not answer, or has forgotten the task.
            Deadlock, TaskKilled, Stopped: in a handler, as for ``TaskRef.wait``.
        """
        check(self._what, TIMEOUT, timeout=timeout)
        return self._convert(self._unread.pop()) if self._wait_for_next(timeout) else None

    def _wait_for_next(self, timeout: float | None) -> bool:
        """Wait for the next element; return False if the stream has ended. Raises Timeout."""
        if self._is_closed:
            return False
        if self._observation.wait(self._has_unread, timeout):
            return True
        if self._observation.is_over:
            return False
        raise Timeout(f"{self._what} did not come within {timeout:g} s", can_wait=True)

    async def __anext__(self) -> T:
        if not await self._has_next():
            raise StopAsyncIteration
        return self._pop()

    async def _has_next(self) -> bool:
        """Await the next element; return False if the stream has ended."""
        return not self._is_closed and await awaited(
            self._observation.wait_in_coroutine(self._has_unread)
        )

    def _pop(self) -> T:
        return self._convert(self._unread.pop())

    def _has_unread(self) -> bool:
        return bool(self._unread)

    def arrived(self) -> list[T]:
        """Return the elements that have arrived by now. Never waits.

        Raises:
            Refused, CentralLost: no element has arrived, and the observation has failed.
        """
        self._observation.catch_up()
        elements = []
        while self._unread:
            elements.append(self._convert(self._unread.pop()))
        if not elements and not self._is_closed:
            self._observation.check()
        return elements

    def close(self) -> None:
        """End the stream, as the end of a ``with`` block does. Closing again does nothing."""
        self._is_closed = True
        self._observation.remove_reader(self._unread)
        if self._is_owner:
            self._observation.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


@types.coroutine
def awaited(waiting: Generator[Any, None, T]) -> Generator[Any, None, T]:
    """Await a wait of a connection."""
    return (yield from waiting)
