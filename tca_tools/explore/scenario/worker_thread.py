"""A separate thread for each exploration, since an exploration runs functions of the user.

A function that catches every error and continues can't be ended by an error. Its thread then
sleeps forever, and the exploration ends without it.
"""

import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, NoReturn, TypeVar

T = TypeVar("T")


class _ThreadState(threading.local):
    future: "Future[Any] | None" = None  #: the result of this thread's work
    is_abandoned: threading.Event


_state = _ThreadState()


class _Abandoned(BaseException):
    """Ends a worker thread whose result is no longer awaited."""


def in_worker_thread(work: Callable[[], T]) -> T:
    """Run *work* in a thread; return its result or raise its error."""
    future: Future[T] = Future()
    is_abandoned = threading.Event()

    def run() -> None:
        _state.future, _state.is_abandoned = future, is_abandoned
        try:
            future.set_result(work())
        except BaseException as error:  # noqa: BLE001 - raised in the thread that waits
            future.set_exception(error)

    threading.Thread(target=run, name="explorer", daemon=True).start()
    try:
        return future.result()
    finally:
        is_abandoned.set()  # Ctrl-C ends the wait


def check_not_abandoned() -> None:
    """End the work of this thread if its result is no longer awaited."""
    if _state.future is not None and _state.is_abandoned.is_set():
        raise _Abandoned


def abandon_thread(error: BaseException) -> NoReturn:
    """Let the work of this thread fail with *error*, and the thread sleep forever."""
    if _state.future is None:
        raise error
    _state.future.set_exception(error)
    while True:
        threading.Event().wait()
