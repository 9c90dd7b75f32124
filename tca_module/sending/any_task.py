"""The wait for the first of several tasks to end."""
# ruff: noqa: SLF001 - a wait for many tasks consists of waits for each

import math
from collections.abc import Callable, Sequence

from tca_module import checks
from tca_module.checks import LateText, check, is_brief
from tca_module.errors import MisuseError
from tca_module.link.connection import Connection
from tca_module.link.packet_line import STALL
from tca_module.link.waits import AnnouncedWait
from tca_module.sending.task_ref import TaskRef
from tca_module.session.request import Request

_CALL = "wait_for_any()"
_PERIOD = 0.05  # seconds between two calls of *until*


def wait_for_any(
    tasks: Sequence[TaskRef],
    timeout: float | None = None,
    *,
    until: Callable[[], object] | None = None,
) -> list[TaskRef]:
    """Wait until at least one of the tasks has ended, and return those that have.

    A failed task raises no error here. Its ``result()`` raises the error, without waiting.

    Args:
        tasks: one or more tasks of one client, module or handler.
        timeout: the most seconds to wait. Default: None, no bound.
        until: a function that is called 20 times a second. A true value that it returns ends the
            wait. Default: None.

    Returns:
        The tasks that have ended; [] after *timeout*, or if *until* ended the wait.

    Raises:
        MisuseError: *tasks* is empty, or the tasks belong to different senders.
        Deadlock: in a handler: the wait would never end.
        CentralLost: central does not answer.
        TaskKilled: in a handler: its task was killed.
        Stopped: in a handler: its module ends.

    Example::

        moves = [task.command(MOVE, arm) for arm in arms]
        for move in wait_for_any(moves, timeout=10):
            print(move, "has ended:", move.wait())
    """
    return first_ended(tasks, timeout, until, brief=is_brief(_CALL, timeout) or until is not None)


def first_ended(
    tasks: Sequence[TaskRef],
    timeout: float | None,
    until: Callable[[], object] | None,
    *,
    brief: bool,
) -> list[TaskRef]:
    """Do the work of ``wait_for_any``.

    *brief*: the timeout is short, or something else may end the wait. So the wait is no deadlock.
    """
    check(_CALL, checks.TIMEOUT, timeout=timeout)
    is_list = isinstance(tasks, Sequence) and bool(tasks)
    if not is_list or not all(isinstance(task, TaskRef) for task in tasks):
        text = f"needs a list of tasks that were sent or found, not {tasks!r:.60}"
        raise MisuseError(f"{_CALL} {text}")
    if ended := [task for task in tasks if task._end is not None]:
        return ended
    connection = tasks[0]._connection()
    if any(task._connection() is not connection for task in tasks):
        raise MisuseError(f"{_CALL}: all tasks must be those of one client, module or handler")
    requests = {task: task._request_point(task.achieving.end, blocking=False) for task in tasks}
    try:
        what = LateText(lambda: f"the wait for {' or '.join(map(str, tasks))}")
        _wait(connection, list(requests.values()), timeout, until, what, brief=brief)
    finally:
        for request in requests.values():
            if not request.is_over:
                connection.abandon(request)
    ended = [task for task, request in requests.items() if request.is_over]
    for task in ended:
        requests[task].check(f"the wait for {task}")
        task._end = requests[task].answers[-1]
    return ended


def _wait(
    connection: Connection,
    requests: list[Request],
    timeout: float | None,
    until: Callable[[], object] | None,
    what: object,
    *,
    brief: bool,
) -> None:
    """Wait until a request is over, *until* returns a true value, or the timeout has passed."""

    def is_over() -> bool:
        return any(request.is_over for request in requests)

    wait = AnnouncedWait(connection, [] if timeout == 0 else requests, brief)
    started = since = now = connection.now()
    longest_step = math.inf if until is None else _PERIOD
    while not is_over() and not (until is not None and until()):
        left = math.inf if timeout is None else max(0.0, started + timeout - now)
        step = min(left, longest_step)
        connection.wait(requests[0], None if step == math.inf else step, what, is_over, since, wait)
        before, now = now, connection.now()
        if now - before > _PERIOD + STALL and until is not None:
            # This process stood still, so central's silence counts from now on.
            since = now
        if left == 0.0:
            return
