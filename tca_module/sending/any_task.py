"""The wait for the first of several tasks to end."""
# ruff: noqa: SLF001 - a wait for many tasks is made of those for each

from collections.abc import Callable, Sequence

from tca_module import checks
from tca_module.checks import LateText, check, is_brief
from tca_module.errors import MisuseError
from tca_module.link.connection import Connection
from tca_module.link.packet_line import STALL
from tca_module.link.waits import ToldWait
from tca_module.sending.task_ref import TaskRef
from tca_module.session.request import Request

_CALL = "wait_for_any()"
_PERIOD = 0.05  # seconds between two questions whether to go on waiting


def wait_for_any(
    tasks: Sequence[TaskRef],
    timeout: float | None = None,
    *,
    until: Callable[[], object] | None = None,
) -> list[TaskRef]:
    """Wait until at least one of the tasks has ended; those that have.

    [] if none has after *timeout* seconds, or when *until*, which is asked 20 times a second, gives
    something true. A task that failed is no error here: its ``result()`` raises it, without
    waiting.
    """
    return first_ended(tasks, timeout, until, brief=is_brief(_CALL, timeout) or until is not None)


def first_ended(
    tasks: Sequence[TaskRef],
    timeout: float | None,
    until: Callable[[], object] | None,
    *,
    brief: bool,
) -> list[TaskRef]:
    """``wait_for_any``. *brief*: other things may end the wait, or time soon does: it is no
    deadlock.
    """
    check(_CALL, checks.TIMEOUT, timeout=timeout)
    if not tasks or not all(isinstance(task, TaskRef) for task in tasks):
        raise MisuseError(
            f"{_CALL} needs a list of tasks that were sent or found, not {tasks!r:.60}"
        )
    if ended := [task for task in tasks if task._end is not None]:
        return ended
    connection = tasks[0]._connection()
    if any(task._connection() is not connection for task in tasks):
        raise MisuseError(f"{_CALL}: all tasks must be those of one client, module or handler")
    asked = {task: task._ask(task.achieving.end, blocking=False) for task in tasks}
    try:
        what = LateText(lambda: f"the wait for {' or '.join(map(str, tasks))}")
        _wait(connection, list(asked.values()), timeout, until, what, brief=brief)
    finally:
        for request in asked.values():
            if not request.is_over:
                connection.abandon(request)
    heard = [task for task, request in asked.items() if request.is_over]
    for task in heard:
        asked[task].check(f"the wait for {task}")
        task._end = asked[task].answers[-1]
    return heard


def _wait(
    connection: Connection,
    requests: list[Request],
    timeout: float | None,
    until: Callable[[], object] | None,
    what: object,
    *,
    brief: bool,
) -> None:
    """Wait until one of the requests is over, or *until* says that it is enough."""

    def is_over() -> bool:
        return any(request.is_over for request in requests)

    told, began = ToldWait(connection, [] if timeout == 0 else requests, brief), connection.now()
    since = now = began
    while not is_over() and not (until is not None and until()):
        left = None if timeout is None else max(0.0, began + timeout - now)
        step = left if until is None else _PERIOD if left is None else min(_PERIOD, left)
        connection.wait(requests[0], step, what, is_over, since, told)
        before, now = now, connection.now()
        if now - before > _PERIOD + STALL and until is not None:
            since = now  # this process stood still: blame nobody
        if left == 0.0:
            return
