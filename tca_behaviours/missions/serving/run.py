"""One run of a task: ``initialise``, ``iterate``, and ``terminate`` however the run ends."""

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
        self._method = ""  #: the task's method that runs with the environment locked, if any
        self._thread = threading.get_ident()
        self._published = TaskStatus()  #: the status that observers know
        self._next_status_at = 0.0  #: the earliest time of the next status

    def carry_out(self) -> TaskEnd:
        """Run the task to its end. After ``initialise`` has succeeded, ``terminate`` is called,
        whatever happens.

        Raises the failure of the run, or the exception that ended a wait of the run, such as
        TaskKilled.
        """
        self._initialise()
        try:
            with self._warned_if_late():
                if isinstance(self.served, PeriodicTask):
                    self._iterate_periodically(self.served)
                else:
                    self._iterate_once()
        except BaseException as error:
            self._terminate_after(error)
            raise
        self._terminate(Status.COMPLETED)
        return TaskEnd(Status.COMPLETED | Status.TERMINATED, self.served.status_text, self.overruns)

    def _initialise(self) -> None:
        try:
            with self._environment_locked("initialise"):
                self.served.initialise()
        except Exception as error:
            if self.task.cancelled:
                raise
            self.status = Status.INITIALISATION_FAILED
            if isinstance(error, FailureRaised):
                # The new failure's name says enough: leave out "mission task failed".
                text = error.text if error.name == MISSION_TASK_FAILED.name else str(error)
            else:
                self._log.exception("initialise() of %s failed", self.task)
                text = f"{type(error).__name__}: {error}"
            raise MISSION_TASK_INITIALISATION_FAILED(text=self._with_status(text)) from error
        self.status = Status.INITIALISED

    # --- working ----------------------------------------------------------------------------------

    def _iterate_periodically(self, served: PeriodicTask[Any]) -> None:
        began, self.status = self.task.time(), Status.RUNNING
        period = Period(began, served.task_period)
        while True:
            with self._environment_locked("iterate"):
                if self._is_completed(served.iterate()):
                    return
            now, was_due = self.task.time(), period.due
            due = period.next(now, served.task_period)
            self._count_overruns(period, now - was_due)
            self._wait_until(min(due, began + served.task_timeout) if served.task_timeout else due)
            # Read task_timeout again: an update may have changed it during the wait.
            if served.task_timeout and self.task.time() >= began + served.task_timeout:
                raise self._timeout()

    def _count_overruns(self, period: Period, since_due: float) -> None:
        """Count the missed periods, and log the first."""
        if period.missed > self.overruns == 0:
            text = "%s misses its period of %g s: an iteration ended %.3g s after it was due"
            self._log.warning(text, self.task, period.seconds, since_due)
        self.overruns = period.missed

    def _iterate_once(self) -> None:
        self.status, seconds = Status.RUNNING, self.served.task_timeout

        def fail_late(callback: Callback) -> None:
            if (ref := callback.task(self.task.id)) is not None:
                ref.fail(self._timeout())

        timer = self._start_timer(seconds, fail_late) if seconds else None
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
    def _warned_if_late(self) -> Iterator[None]:
        """A block. If the block has not ended soon after ``task_timeout``, log a warning.

        Nothing can end an iterate() that hangs; the warning at least names it.
        """
        began, seconds = self.task.time(), self.served.task_timeout
        timer: Callback | None = None

        def warn_if_late(callback: Callback) -> None:
            nonlocal timer
            seconds = self.served.task_timeout  # an update may have changed it
            remaining = began + seconds + _RETURNS_WITHIN - callback.time()
            if not seconds or self._is_ending:
                return
            if remaining > 0:
                timer = self._start_timer(remaining, warn_if_late)
            else:
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
            text=self._with_status(f"it ran for {self.served.task_timeout:g} s")
        )

    def _is_completed(self, returned: object) -> bool:
        """Return whether ``iterate`` returned COMPLETED. Raises a failure if it returned neither
        COMPLETED nor RUNNING.
        """
        if returned in (Status.RUNNING, Status.COMPLETED):
            return returned == Status.COMPLETED
        if not isinstance(returned, Status):
            raise self.served.failed(
                f"iterate() returned {returned!r:.60}: return Status.RUNNING or Status.COMPLETED"
            )
        raise self.served.failed(self._with_status(f"iterate() returned {returned.name}"))

    # --- reports ----------------------------------------------------------------------------------

    def publish(self) -> None:
        """Publish the run's status if it has changed, but not too often.

        Soon after the last report, nothing is published: the next iteration does that.
        """
        if self._is_ending or threading.get_ident() != self._thread:
            return  # another thread of the task: the next iteration publishes its text
        status = TaskStatus(self.served.status_text, self.overruns, self.status)
        if (
            status != self._published
            and self.status is not Status.NEWBORN
            and self.task.time() >= self._next_status_at
        ):
            self._published, self._next_status_at = status, self.task.time() + _STATUS_PERIOD
            self.task.report(status)

    def publish_wait(self, awaited: str) -> None:
        """Publish that the run waits for a task with the name *awaited*; "": the wait is over."""
        text = f"waits until {awaited} has terminated" if awaited else ""
        self._published = TaskStatus(text, status=Status.NEWBORN)
        self.task.report(self._published)

    def sleep(self, seconds: float) -> None:
        """Sleep, and answer updates and kills in the meantime, with the environment unlocked."""
        method, until = self._method, self.task.time() + seconds
        if not method:
            self._wait_until(until)
            return
        self.served.env.lock.release()
        try:
            self._wait_until(until)
        finally:
            self._lock(method)

    def _wait_until(self, time: float) -> None:
        if self._is_ending:
            self.task.sleep_until(time)
            return
        self.publish()
        while (
            request := self.task.wait_for_request(max(0.0, time - self.task.time()))
        ) is not None:
            if why := self.definition.reason_to_reject(self.served, request.goal):
                request.reject(why)
            else:
                request.accept(self.definition.change(self.served, request.goal))

    # --- the end ----------------------------------------------------------------------------------

    def _terminate(self, status: Status) -> None:
        """Call ``terminate``. Raises its error."""
        self._is_ending, self.status = True, status
        with self.task.shielded(), self._environment_locked("terminate"):
            self.served.terminate()

    def _terminate_after(self, error: BaseException) -> None:
        """Call ``terminate`` after *error*. An error of ``terminate`` becomes a note of *error*."""
        status = status_of(error.name) if isinstance(error, FailureRaised) else Status.FAILED
        try:
            self._terminate(Status.INTERRUPTED if self.task.cancelled else status)
        except Exception as second:  # noqa: BLE001 - only a note of the error that ended the run
            self._log.exception("terminate() of %s failed", self.task)
            error.add_note(f"terminate() failed, too: {type(second).__name__}: {second}")

    @contextlib.contextmanager
    def _environment_locked(self, method: str) -> Iterator[None]:
        """A block in which *method* runs with the environment locked."""
        self._lock(method)
        self._method = method
        try:
            yield
        finally:
            self._method = ""
            self.served.env.lock.release()

    def _lock(self, method: str) -> None:
        """Lock the environment for *method*. A long wait is logged."""
        while not self.served.env.lock.acquire(timeout=_PATIENCE):
            self._log.warning(
                "%s() of %s waits for env.lock, which another task holds", method, self.task
            )

    # --- texts ------------------------------------------------------------------------------------

    def _with_status(self, text: str) -> str:
        """Return the text, followed by the task's status text."""
        return f"{text}: {self.served.status_text}" if self.served.status_text else text
