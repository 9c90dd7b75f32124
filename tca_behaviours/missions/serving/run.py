"""One run of a task: initialise, iterate, terminate, however it ends."""

import contextlib
import logging
import threading
from collections.abc import Callable, Iterator
from typing import Any

from tca_behaviours.missions.outcomes import (
    MISSION_TASK_FAILED,
    MISSION_TASK_INITIALISATION_FAILED,
    MISSION_TASK_TIMEOUT,
    Status,
    TaskEnd,
    TaskStatus,
    status_of,
)
from tca_behaviours.missions.serving.definition import Definition, PeriodicTask, ServedTask
from tca_module import Callback, FailureRaised, Task
from tca_module.period import Period

StartTimer = Callable[[float, Callable[[Callback], object]], Callback]
"""Calls a function after a number of seconds, in another thread."""

_STATUS_PERIOD = 0.2  # the least seconds between two reports of a run's status
_PATIENCE = 5.0  # seconds that a task waits for the environment between two warnings
_RETURNS_WITHIN = 2.0  # seconds after task_timeout until a running iterate() is logged


class TaskRun:
    """A running task."""

    def __init__(
        self,
        definition: Definition,
        served: ServedTask[Any],
        start_timer: StartTimer,
        log: logging.Logger,
    ) -> None:
        self.definition = definition
        self.served = served
        served._run = self  # noqa: SLF001 - the task's own run
        self.task: Task = served.task
        self.status = Status.NEWBORN
        self.overruns = 0  #: the number of periods that were missed
        self._start_timer = start_timer
        self._log = log
        self._is_ending = False
        self._method = ""  #: the method that holds the environment's lock
        self._thread = threading.get_ident()
        self._published = TaskStatus()  #: the status that observers know
        self._publish_from = 0.0  #: the earliest time of the next status

    def carry_out(self) -> TaskEnd:
        """Run the task to its end, and terminate it whatever happens.

        Raises its failure, or the exception that woke it.
        """
        self._initialise()
        try:
            with self._watched():
                if isinstance(self.served, PeriodicTask):
                    self._iterate_periodically(self.served)
                else:
                    self._iterate_once()
        except BaseException as error:
            self._terminate_after(error)
            raise
        self._terminate()
        return TaskEnd(Status.COMPLETED | Status.TERMINATED, self.served.status_text, self.overruns)

    def _initialise(self) -> None:
        try:
            with self._environment("initialise"):
                self.served.initialise()
        except Exception as error:
            if self.task.cancelled:
                raise
            self.status = Status.INITIALISATION_FAILED
            if not isinstance(error, FailureRaised):
                self._log.exception("initialise() of %s failed", self.task)
            raise MISSION_TASK_INITIALISATION_FAILED(text=self._why(error)) from error
        self.status = Status.INITIALISED

    # --- working ----------------------------------------------------------------------------------

    def _iterate_periodically(self, served: PeriodicTask[Any]) -> None:
        began, self.status = self.task.time(), Status.RUNNING
        period = Period(began, served.task_period)
        while True:
            with self._environment("iterate"):
                if self._is_completed(served.iterate()):
                    return
            now, was_due = self.task.time(), period.due
            due = period.next(now, served.task_period)
            self._count_overruns(period, now - was_due)
            self._wait_until(min(due, began + served.task_timeout) if served.task_timeout else due)
            # Read task_timeout again: an update may have changed it during the wait.
            if served.task_timeout and self.task.time() >= began + served.task_timeout:
                raise self._timeout()

    def _count_overruns(self, period: Period, took: float) -> None:
        if period.missed > self.overruns == 0:
            text = "%s misses its period of %g s: an iteration ended %.3g s after it was due"
            self._log.warning(text, self.task, period.seconds, took)
        self.overruns = period.missed

    def _iterate_once(self) -> None:
        self.status, task, seconds = Status.RUNNING, self.task.id, self.served.task_timeout

        def fail(callback: Callback) -> None:
            if (late := callback.task(task)) is not None:
                late.fail(self._timeout())

        timer = self._start_timer(seconds, fail) if seconds else None
        try:
            returned = self.served.iterate()
            if returned is not None and not self._is_completed(returned):
                raise self.served.failed(
                    "iterate() returned RUNNING, but the task runs once: return COMPLETED"
                )
        finally:
            if timer is not None:
                timer.cancel()

    @contextlib.contextmanager
    def _watched(self) -> Iterator[None]:
        """A block that is logged if it has not ended soon after ``task_timeout``.

        Nothing can end an iterate() that hangs; the log at least names it.
        """
        began, seconds = self.task.time(), self.served.task_timeout
        timer: Callback | None = None

        def warn_if_late(callback: Callback) -> None:
            nonlocal timer
            seconds = self.served.task_timeout  # an update may have changed it
            remaining = began + seconds + _RETURNS_WITHIN - callback.time()
            if seconds and remaining > 0 and not self._is_ending:
                timer = self._start_timer(remaining, warn_if_late)
            elif seconds and not self._is_ending:
                text = "%s: task_timeout of %g s has passed and iterate() has not returned"
                self._log.warning(text, self.task, seconds)

        if seconds:
            timer = self._start_timer(seconds + _RETURNS_WITHIN, warn_if_late)
        try:
            yield
        finally:
            if timer is not None:
                timer.cancel()

    def _timeout(self) -> FailureRaised:
        return MISSION_TASK_TIMEOUT(
            text=self._with_text(f"it ran for {self.served.task_timeout:g} s")
        )

    def _is_completed(self, returned: object) -> bool:
        if returned in (Status.RUNNING, Status.COMPLETED):
            return returned == Status.COMPLETED
        if not isinstance(returned, Status):
            raise self.served.failed(
                f"iterate() returned {returned!r:.60}: return Status.RUNNING or Status.COMPLETED"
            )
        raise self.served.failed(self._with_text(f"iterate() returned {returned.name}"))

    # --- reports ----------------------------------------------------------------------------------

    def publish(self) -> None:
        """Publish the run's status if it has changed, but not too often.

        A status that comes too early is left out: the next iteration publishes it.
        """
        if self._is_ending or threading.get_ident() != self._thread:
            return  # another thread of the task: the next iteration publishes its text
        status = TaskStatus(self.served.status_text, self.overruns, self.status)
        if (
            status != self._published
            and self.status is not Status.NEWBORN
            and self.task.time() >= self._publish_from
        ):
            self._published, self._publish_from = status, self.task.time() + _STATUS_PERIOD
            self.task.report(status)

    def publish_wait(self, for_whom: str) -> None:
        """Publish that the run waits for the task *for_whom*; "": it waits no longer."""
        self._published = TaskStatus(
            f"waits until {for_whom} has terminated" if for_whom else "", status=Status.NEWBORN
        )
        self.task.report(self._published)

    def sleep(self, seconds: float) -> None:
        """Sleep, and answer updates and kills in the meantime. Releases the environment's lock
        until then.
        """
        method, moment = self._method, self.task.time() + seconds
        if not method:
            self._wait_until(moment)
            return
        self.served.env.lock.release()
        try:
            self._wait_until(moment)
        finally:
            self._lock(method)

    def _wait_until(self, moment: float) -> None:
        if self._is_ending:
            self.task.sleep_until(moment)
            return
        self.publish()
        while (
            request := self.task.wait_for_request(max(0.0, moment - self.task.time()))
        ) is not None:
            if why := self.definition.why_fixed(self.served, request.goal):
                request.reject(why)
            else:
                request.accept(self.definition.change(self.served, request.goal))

    # --- the end ----------------------------------------------------------------------------------

    def _terminate(self) -> None:
        """Call ``terminate``. Raises its error."""
        self._is_ending, self.status = True, Status.COMPLETED
        with self.task.shielded(), self._environment("terminate"):
            self.served.terminate()

    def _terminate_after(self, error: BaseException) -> None:
        """Call ``terminate`` after *error*. An error of its own becomes a note of *error*."""
        self._is_ending = True
        self.status = status_of(error.name) if isinstance(error, FailureRaised) else Status.FAILED
        if self.task.cancelled:
            self.status = Status.INTERRUPTED
        try:
            with self.task.shielded(), self._environment("terminate"):
                self.served.terminate()
        except Exception as second:  # noqa: BLE001 - only a note of the error that ended the run
            self._log.exception("terminate() of %s failed", self.task)
            error.add_note(f"terminate() failed, too: {type(second).__name__}: {second}")

    @contextlib.contextmanager
    def _environment(self, method: str) -> Iterator[None]:
        """A block in which no other task uses the environment. A long wait for it is logged."""
        self._lock(method)
        self._method = method
        try:
            yield
        finally:
            self._method = ""
            self.served.env.lock.release()

    def _lock(self, method: str) -> None:
        while not self.served.env.lock.acquire(timeout=_PATIENCE):
            self._log.warning(
                "%s() of %s waits for env.lock, which another task holds", method, self.task
            )

    # --- words ------------------------------------------------------------------------------------

    def _with_text(self, words: str) -> str:
        return f"{words}: {self.served.status_text}" if self.served.status_text else words

    def _why(self, error: Exception) -> str:
        if isinstance(error, FailureRaised):
            is_plain = error.name == MISSION_TASK_FAILED.name
            return self._with_text(error.text) if is_plain else self._with_text(str(error))
        return self._with_text(f"{type(error).__name__}: {error}")
