"""A new goal for a running task, and the answer of its server."""

from collections.abc import Generator
from typing import Any

from tca_module.checks import TIMEOUT, check
from tca_module.errors import Rejected, Timeout
from tca_module.following.mirror import Mirror
from tca_module.following.observation import UnreadChanges
from tca_module.session.request import Request
from tca_wire.life_cycles import Effect, LifeCycle, Transition
from tca_wire.packets.parts import StateChange
from tca_wire.vocabulary import Party


class PendingUpdate:
    """A new goal that was sent to a running task; ``wait()`` waits for the handler's answer.

    In an async handler ``await`` does the same.

    Example::

        pending = grasping.update_send(Grip("cup"))
        pending.wait(timeout=5)
    """

    def __init__(
        self,
        what: str,
        mirror: Mirror,
        unread: UnreadChanges,
        request: Request,
        life_cycle: LifeCycle,
        row: Transition,
    ) -> None:
        self._what = what
        self._mirror = mirror
        self._unread = unread  # the changes since before the update was sent
        self._request = request  # for the client's transition, *row*
        self._goal = bytes(request.body)
        self._life_cycle = life_cycle
        self._row = row
        self._is_over = False
        self._reason = ""  # the reason of the rejection
        self._newer = ""  # a client's transition that has come after the update
        request.notify = self._mirror.wake_waiter

    @property
    def is_over(self) -> bool:
        """Whether the new goal was accepted or rejected. Never waits."""
        self._mirror.catch_up()
        return self._read_answer()

    def wait(self, timeout: float | None = None) -> None:
        """Wait until the new goal is the task's.

        Args:
            timeout: the most seconds to wait. Default: None, no bound.

        Raises:
            Rejected: the handler rejected the goal, with its reason; or the task ended first.
            Refused: the task can't get a new goal in its state.
            Timeout: the handler did not answer in time.
            CentralLost: central does not answer, or has forgotten the task.
            Deadlock, TaskKilled, Stopped: in a handler, as for ``TaskRef.wait``.
        """
        check(self._what, TIMEOUT, timeout=timeout)
        if not self._mirror.wait(self._read_answer, timeout) and not self._mirror.is_over:
            text = f"{self._what} was neither accepted nor rejected within {timeout:g} s"
            raise Timeout(text, can_wait=True)
        self._check()

    def __await__(self) -> Generator[Any, None, None]:
        yield from self._mirror.wait_in_coroutine(self._read_answer)
        self._check()

    def _check(self) -> None:
        """Raise the error that the update ended with, if any."""
        if self._request.has_failed:
            self._mirror.connection.session.sends.discard(self._request)
            self._request.check(self._what)
        if not self._is_over:
            self._mirror.check()
            self._finish("the task has ended")
        if self._reason:
            raise Rejected(self._what, self._reason)

    def _finish(self, reason: str = "") -> None:
        self._is_over, self._reason = True, reason

    def _read_answer(self) -> bool:
        """Read the changes that have arrived; return whether the update is over."""
        if self._is_over or not self._request.is_over:
            return self._is_over
        if self._request.has_failed:
            return True
        serial = self._request.accepted or 0  # 0: central did not make the client's transition
        if not serial:
            state = self._mirror.known_state or "about to end"
            self._finish(f"it came too late, the task is {state}")
        moved_on = ""  # the state to which the server has moved on
        while self._unread and not self._is_over:
            observed = self._unread.pop()
            change = observed.change
            if change.serial >= serial or change.is_over:
                is_gapless = not (observed.missed or change.is_late)
                moved_on = self._examine(change, is_gapless=is_gapless)
        if moved_on and not self._is_over:  # central sends the request to the server only once
            self._finish(self._overtaken or f"the task is {moved_on} by now")
        return self._is_over

    @property
    def _overtaken(self) -> str:
        """The reason that a newer request of a client has overtaken the update; "" if none has."""
        return f"it was overtaken by a newer '{self._newer}'" if self._newer else ""

    def _examine(self, change: StateChange, *, is_gapless: bool) -> str:
        """Examine one change: the update's own transition, or a later one.

        If the server has moved on without an answer, this returns its state; otherwise "".
        *is_gapless*: no change was missed directly before this change.
        """
        effects = {
            row.effect
            for row in self._life_cycle.transitions
            if (row.name, row.target) == (change.transition, change.state)
        }
        is_waiting = self._life_cycle.grant(change.state) is not None
        is_own = change.request == self._request.accepted
        if change.is_over:
            why = f": {change.text}" if change.text else ""
            self._finish(self._overtaken or f"the task is {change.state or 'over'}{why}")
        elif not is_gapless and not is_waiting:
            is_adopted = change.goal == self._goal
            self._finish("" if is_adopted else "changes were missed, and it is not the task's goal")
        elif (Effect.TAKE_GOAL in effects and is_own) or (
            change.transition == "restarted" and not (self._can_grant or self._newer)
        ):
            self._finish()
        elif Effect.REFUSE in effects and is_own:
            self._finish(change.text or "its handler gives no reason")
        elif change.transition == "restarted":
            self._finish(self._overtaken or "its handler was called again, without it")
        elif change.by is Party.CLIENT:
            # The server may still answer the update, if it has not seen the newer request.
            if change.request > (self._request.accepted or 0):
                self._newer = change.transition
        elif not is_waiting:
            return change.state
        return ""

    @property
    def _can_grant(self) -> bool:
        """Whether the life cycle has a transition by which the server accepts the goal."""
        return self._life_cycle.grant(self._row.target) is not None
