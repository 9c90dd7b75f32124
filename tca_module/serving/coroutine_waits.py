"""Tells central which answers a coroutine awaits, so that it detects deadlocks through ``await``.

A handler *stands* when only answers from central let it continue. Each of its asyncio tasks then
awaits an answer from central, or only other asyncio tasks of the same handler. Central may treat
the handler as waiting for the first of these answers. Central is informed when the handler has
stood for a second.

A handler that awaits anything else, such as a timer or a device, may continue without central. So
central is not informed.
"""

import asyncio
import inspect
from collections.abc import Callable, Collection, Coroutine, Iterator
from contextlib import contextmanager, suppress
from typing import Any, TypeVar
from weakref import WeakKeyDictionary, WeakSet

from tca_module.checks import BRIEF
from tca_module.errors import CentralLost
from tca_module.link.connection import Connection
from tca_module.session.epoch_numbers import with_epoch
from tca_module.session.open_deliveries import OpenDelivery, current_delivery, working_on
from tca_module.session.request import Request
from tca_wire.packets.headers import AwaitAny

T = TypeVar("T")

MOST_AWAITED = 1000  # answers; a handler that awaits more answers at a time is ignored

_Numbers = tuple[int, ...]  # the numbers of the requests at which a handler stands


class CoroutineWaits:
    """The asyncio tasks of the handlers of one event loop, and what they await."""

    def __init__(
        self, loop: asyncio.AbstractEventLoop, connection: Connection, on_change: Callable[[], None]
    ) -> None:
        """*on_change* is called when a handler continues that central counts as standing."""
        self._on_change = on_change
        self._connection = connection
        self._loop = loop
        #: handler -> all asyncio tasks started in it
        self._tasks_of: dict[OpenDelivery, WeakSet[asyncio.Task[Any]]] = {}
        #: asyncio task -> the request that it awaits, and the future of its news
        self._awaited = WeakKeyDictionary[asyncio.Task[Any], tuple[Request, asyncio.Future[None]]]()
        #: handler -> the numbers of the requests at which it stands, and since when
        self._standing_since: dict[OpenDelivery, tuple[_Numbers, float]] = {}
        #: handler that central counts as standing -> ``session.breaks`` when central was informed
        self._reported: dict[OpenDelivery, int] = {}
        self._factory = self._create_task
        loop.set_task_factory(self._factory)

    def start_task(
        self, handler: OpenDelivery, coroutine: Coroutine[Any, Any, T]
    ) -> "asyncio.Task[T]":
        """Start an asyncio task for a handler."""
        self._tasks_of[handler] = WeakSet()
        with working_on(handler):
            task = self._loop.create_task(coroutine)
        task.add_done_callback(lambda _: self._forget(handler))
        return task

    def _create_task(self, loop: asyncio.AbstractEventLoop, coroutine: Any, **options: Any) -> Any:
        task = asyncio.Task(coroutine, loop=loop, **options)
        handler = current_delivery(options.get("context"))
        if handler is not None and (tasks := self._tasks_of.get(handler)) is not None:
            tasks.add(task)
            self._report_continued(handler)
        return task

    def _forget(self, handler: OpenDelivery) -> None:
        for known in (self._tasks_of, self._standing_since, self._reported):
            known.pop(handler, None)

    @contextmanager
    def awaiting(self, request: Request, future: "asyncio.Future[None]") -> Iterator[None]:
        """Return a block in which the current asyncio task awaits news of a request."""
        task = asyncio.current_task()
        assert task is not None
        self._awaited[task] = request, future
        if (handler := current_delivery()) is not None:
            self._report_continued(handler)
        try:
            yield
        finally:
            self._awaited.pop(task, None)

    def report_standing(self, now: float) -> bool:
        """Inform central of the handlers that have stood for a second.

        Call this from time to time while it returns True. False means that central knows where each
        handler stands. Then call this again only after a change.
        """
        session = self._connection.session
        for handler in list(self._tasks_of):
            standing = self._standing(handler)
            previous, since = self._standing_since.get(handler, ((), now))
            if standing != previous or not standing:
                self._standing_since[handler] = standing, now
                self._report_continued(handler)
            elif (
                now - since >= BRIEF
                and session.is_welcome
                and self._reported.get(handler) != session.breaks
            ):
                self._reported[handler] = session.breaks
                self._report(handler, standing)
        return any(self._reported.get(handler) != session.breaks for handler in self._tasks_of)

    def _report_continued(self, handler: OpenDelivery) -> None:
        if self._reported.pop(handler, None) is not None:
            self._report(handler, ())
            self._on_change()

    def _report(self, handler: OpenDelivery, standing: _Numbers) -> None:
        """Inform central where a handler stands, unless a restarted central has forgotten it."""
        session = self._connection.session
        if session.open_deliveries.is_open(handler):
            delivery = with_epoch(handler.delivery, session.epoch, handler.name)
            with suppress(CentralLost):  # central was restarted just now
                self._connection.post(AwaitAny(delivery, list(standing)), b"")

    def _standing(self, handler: OpenDelivery) -> _Numbers:
        """Return the requests at which a handler stands: an answer to any one lets it continue.

        Returns () if anything else may let the handler continue.
        """
        if self._loop.get_task_factory() != self._factory:
            return ()  # the user's task factory creates asyncio tasks that are unknown here
        tasks = {task for task in self._tasks_of[handler] if not task.done()}
        requests = []
        for task in tasks:
            request, future = self._awaited.get(task, (None, None))
            if request is None or future is None:
                members = _members(task)
                if not members or not tasks.issuperset(members):
                    return ()
            elif future.done() or request.is_over or not request.header.number:
                return ()
            else:
                requests.append(request)
        numbers = sorted({request.header.number for request in requests})
        return tuple(numbers) if len(numbers) <= MOST_AWAITED else ()


def _members(task: "asyncio.Task[Any]") -> Collection[Any]:
    """Return the asyncio tasks that a task waits for, with gather(), wait() or in a TaskGroup.

    Returns () if the task waits for anything else.
    """
    future = getattr(task, "_fut_waiter", None)
    if future is None or future.done():
        return ()
    if isinstance(future, asyncio.Task):
        return (future,)
    members = getattr(future, "_children", None) or _members_of_frame(task)
    return [member for member in members if not member.done()]


def _members_of_frame(task: "asyncio.Task[Any]") -> Collection[Any]:
    """Return the asyncio tasks awaited by the asyncio function in which a task is suspended."""
    inner: Any = task.get_coro()
    while inspect.iscoroutine(inner) and inspect.iscoroutine(inner.cr_await):
        inner = inner.cr_await
    if not inspect.iscoroutine(inner) or inner.cr_frame is None:
        return ()
    if inner.cr_frame.f_globals.get("__name__") not in ("asyncio.tasks", "asyncio.taskgroups"):
        return ()
    known = inner.cr_frame.f_locals
    if inner.cr_code.co_name == "_wait" and known.get("timeout_handle") is None:
        return tuple(known.get("fs", ()))
    if inner.cr_code.co_name in ("__aexit__", "_aexit") and isinstance(
        known.get("self"), asyncio.TaskGroup
    ):
        return tuple(getattr(known["self"], "_tasks", ()))
    return ()
