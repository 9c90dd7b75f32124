"""Work in a thread of its own, for it runs functions of the user's. One that catches whatever is
raised in it, and goes on, can't be ended by an error: it is left behind in that thread, asleep.
"""

import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, NoReturn, TypeVar

T = TypeVar("T")


class _ThreadState(threading.local):
    future: "Future[Any] | None" = None  #: of the work that this thread does
    is_abandoned: threading.Event


_state = _ThreadState()


class _Abandoned(BaseException):
    """Nobody waits for the work any more."""


def in_worker_thread(work: Callable[[], T]) -> T:
    """The result of *work*, which is returned or raised."""
    future: Future[T] = Future()
    is_abandoned = threading.Event()

    def run() -> None:
        _state.future, _state.is_abandoned = future, is_abandoned
        try:
            future.set_result(work())
        except BaseException as error:  # noqa: BLE001 - it is raised where somebody waits
            future.set_exception(error)

    threading.Thread(target=run, name="explorer", daemon=True).start()
    try:
        return future.result()
    finally:
        is_abandoned.set()  # Ctrl-C ends the wait


def check_not_abandoned() -> None:
    """Ends the work of this thread if nobody waits for it."""
    if _state.future is not None and _state.is_abandoned.is_set():
        raise _Abandoned


def abandon_thread(error: BaseException) -> NoReturn:
    """End the work with an error, and let this thread sleep for ever."""
    if _state.future is None:
        raise error
    _state.future.set_exception(error)
    while True:
        threading.Event().wait()
