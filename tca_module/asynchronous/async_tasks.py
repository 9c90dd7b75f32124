"""Tasks and streams of changes for the user's own event loop."""
# ruff: noqa: SLF001, ASYNC109 - these do the work of TaskRef and Stream, with the same options

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine
from typing import Any, Concatenate, Generic, ParamSpec, Self, TypeVar

from tca_module.asynchronous.forwarding import (
    Forwarding,
    OnlyAsync,
    RunThere,
    WaitingIn,
    forwarded,
    settle,
)
from tca_module.errors import Timeout
from tca_module.following.stream import Stream
from tca_module.sending.task_points import TaskIntervals
from tca_module.sending.task_ref import TaskRef
from tca_wire.messages.declarations import R
from tca_wire.points import Point, TaskId
from tca_wire.vocabulary import Outcome

P = ParamSpec("P")
T = TypeVar("T")


class AsyncStream(AsyncIterator[T], OnlyAsync, Generic[T]):
    """A ``Stream`` for ``async for`` on the user's own event loop.

    It starts with the first step, or at the start of an ``async with`` block. A step that is
    cancelled loses no element.
    """

    def __init__(self, run: RunThere, start: Callable[[], Stream[T]]) -> None:
        self._run = run
        self._start = start
        self._stream: Stream[T] | None = None

    async def _open(self) -> Stream[T]:
        async def start() -> Stream[T]:
            if self._stream is None:
                self._stream = self._start()
            return self._stream

        stream: Stream[T] = await self._run(start())
        return stream

    async def __anext__(self) -> T:
        stream = self._stream or await self._open()
        # Only this thread takes elements, so an element that has arrived stays until then.
        while not stream._has_unread():
            if not await self._run(_has_next(stream)):
                raise StopAsyncIteration
        return stream._pop()

    async def close(self) -> None:
        """End the stream. Closing again does nothing."""

        async def close() -> None:
            if self._stream is not None:
                self._stream.close()

        await asyncio.shield(self._run(close()))

    async def __aenter__(self) -> Self:
        await self._open()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()


async def _has_next(stream: Stream[Any]) -> bool:
    """Await the next element; return False if the stream has ended. Raises Timeout."""
    try:
        async with asyncio.timeout(stream._timeout):
            return await stream._has_next()
    except TimeoutError:
        text = f"{stream._what} did not come within {stream._timeout:g} s"
        raise Timeout(text, can_wait=True) from None


def streamed(
    method: Callable[Concatenate[Any, P], Stream[T]],
) -> Callable[Concatenate[Any, P], AsyncStream[T]]:
    """Return a method that returns a Stream, as a method that returns an AsyncStream."""

    def call(self: Forwarding, /, *args: Any, **options: Any) -> Any:
        return AsyncStream[Any](self._run, lambda: method(self._blocking, *args, **options))

    call.__doc__ = method.__doc__
    return call


async def _end(task: TaskRef, timeout: float | None) -> None:
    if task._end is None:
        task._end = await _point(task, task.achieving.end, timeout)


async def _point(task: TaskRef, point: Point, timeout: float | None) -> Any:
    """Await a point; return central's answer."""
    request = task._request_point(point, blocking=False, lends_slot=True)
    with task._recalled_if_lost():
        what = f"the wait for {task._describe_point(point)}"
        await settle(task._connection(), request, timeout, what)
    return task._point_answer(request, point, timeout)


async def _wait(task: TaskRef, timeout: float | None = None) -> Outcome:
    await _end(task, timeout)
    return task.wait(0)


async def _wait_for(task: TaskRef, point: Point, timeout: float | None = None) -> Outcome:
    outcome: Outcome = (await _point(task, point, timeout))[0].outcome
    return outcome


async def _result(task: Any, timeout: float | None = None) -> Any:
    await _end(task, timeout)
    return task.result(0)


async def _update(
    task: TaskRef, goal: Any, *, timeout: float | None = None, message: Any = None
) -> None:
    pending = task.update_send(goal, message=message)
    try:
        async with asyncio.timeout(timeout):
            await pending
    except TimeoutError:
        pending.wait(0)


class AsyncTaskRef(Forwarding, TaskIntervals):
    """A ``TaskRef`` for the user's own event loop. Its calls are coroutines.

    Arguments, results and errors are those of the TaskRef's methods. Any asyncio task and any
    thread may use it.

    Attributes:
        message: the name of the task's message.
        id: the task's number, as in the journal.
    """

    _blocking: TaskRef

    def __init__(self, run: RunThere, task: TaskRef) -> None:
        super().__init__(run, task)
        self.message = task.message
        self.id: TaskId = task.id
        self._task_id = task.id

    wait = WaitingIn(_wait)(TaskRef.wait)
    wait_for = WaitingIn(_wait_for)(TaskRef.wait_for)

    @property
    def state(self) -> Coroutine[Any, Any, str]:
        """The task's state, to be awaited: ``await task.state``. See ``TaskRef.state``."""
        return self.call(lambda task: task.state)

    changes = streamed(TaskRef.changes)
    progress = streamed(TaskRef.progress)
    update = WaitingIn(_update)(TaskRef.update)
    cancel = forwarded(TaskRef.cancel)
    kill = forwarded(TaskRef.kill)
    suspend = forwarded(TaskRef.suspend)
    resume = forwarded(TaskRef.resume)
    retry = forwarded(TaskRef.retry)
    fail = forwarded(TaskRef.fail)
    deadline = forwarded(TaskRef.deadline)
    on_failure = forwarded(TaskRef.on_failure)
    on_termination = forwarded(TaskRef.on_termination)
    keep = forwarded(TaskRef.keep)
    release = forwarded(TaskRef.release)
    info = forwarded(TaskRef.info)
    data = forwarded(TaskRef.data)


class AsyncSentTask(AsyncTaskRef, Generic[R]):
    """A task that was sent from the user's own event loop; ``await task.result()`` waits for it.

    Example::

        move = await user.command(MOVE_LEG, 3)
        footfall = await move.result(timeout=10)
    """

    async def result(self, timeout: float | None = None) -> R:
        """Wait until the task has ended, and return the handler's result.

        Args:
            timeout: the most seconds to wait. Default: None, no bound.

        Returns:
            The result; None for a goal.

        Raises:
            TaskFailed, TaskKilled, Timeout, BadData, CentralLost: as for ``SentTask.result``.
        """
        result: R = await self._run(_result(self._blocking, timeout))
        return result
