"""Work in a thread of its own, for it runs functions of the user's. One that catches whatever is
raised in it, and goes on, can't be ended by an error: it is left behind in that thread, asleep.
"""

import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, NoReturn, TypeVar

T = TypeVar("T")


class _Here(threading.local):
    future: "Future[Any] | None" = None  #: of the work that this thread does
    is_unwanted: threading.Event


_here = _Here()


class _Unwanted(BaseException):
    """Nobody waits for the work any more."""


def in_worker_thread(work: Callable[[], T]) -> T:
    """The result of *work*, which is returned or raised."""
    future: Future[T] = Future()
    is_unwanted = threading.Event()

    def run() -> None:
        _here.future, _here.is_unwanted = future, is_unwanted
        try:
            future.set_result(work())
        except BaseException as error:  # noqa: BLE001 - it is raised where somebody waits
            future.set_exception(error)

    threading.Thread(target=run, name="explorer", daemon=True).start()
    try:
        return future.result()
    finally:
        is_unwanted.set()  # Ctrl-C ends the wait


def check_wanted() -> None:
    """Ends the work of this thread if nobody waits for it."""
    if _here.future is not None and _here.is_unwanted.is_set():
        raise _Unwanted


def leave_behind(error: BaseException) -> NoReturn:
    """End the work with an error, and let this thread sleep for ever."""
    if _here.future is None:
        raise error
    _here.future.set_exception(error)
    while True:
        threading.Event().wait()
