"""A new goal for a running task, and the word of its server."""

from collections.abc import Generator
from typing import Any

from tca_module.checks import TIMEOUT, check
from tca_module.errors import Rejected, Timeout
from tca_module.following.mirror import Mirror
from tca_module.following.observation import Unread
from tca_module.session.request import Request
from tca_wire.life_cycles import Effect, LifeCycle, Transition
from tca_wire.packets.parts import StateChange
from tca_wire.vocabulary import Party


class PendingUpdate:
    """A new goal that a task was given. ``wait()`` returns when it is taken over; in async handlers
    ``await`` does.
    """

    def __init__(
        self,
        what: str,
        mirror: Mirror,
        unread: Unread,
        request: Request,
        life_cycle: LifeCycle,
        row: Transition,
    ) -> None:
        self._what = what
        self._mirror = mirror
        self._unread = unread  # of what has come since before it was sent
        self._request = request  # by which central takes the client's transition, *row*
        self._goal = request.body
        self._life_cycle = life_cycle
        self._row = row
        self._is_over = False
        self._reason = ""  # why it was rejected
        request.notify = self._mirror.nudge

    @property
    def is_over(self) -> bool:
        """Whether the new goal was taken over or rejected. Never waits."""
        self._mirror.catch_up()
        return self._look()

    def wait(self, timeout: float | None = None) -> None:
        """Wait until the new goal is the task's. Raises Rejected, with the server's reason, if it
        won't be; Refused if the task can't be given one in its state; Timeout.
        """
        check(self._what, TIMEOUT, timeout=timeout)
        if not self._mirror.wait(self._look, timeout) and not self._mirror.is_over:
            raise Timeout(
                f"{self._what} was neither taken over nor rejected within {timeout:g} s",
                can_wait=True,
            )
        self._check()

    def __await__(self) -> Generator[Any, None, None]:
        yield from self._mirror.until(self._look)
        self._check()

    def _check(self) -> None:
        """Raise the error that it came to, if any."""
        if self._request.has_failed:
            self._mirror.connection.session.sends.discard(self._request)
            self._request.check(self._what)
        if not self._is_over:
            self._mirror.check()
            self._end("the task has ended")
        if self._reason:
            raise Rejected(self._what, self._reason)

    def _end(self, reason: str = "") -> None:
        self._is_over, self._reason = True, reason

    def _look(self) -> bool:
        """Look at what has come; whether it is over."""
        if self._is_over or not self._request.is_over:
            return self._is_over
        if self._request.has_failed:
            return True
        serial = self._request.accepted or 0
        if not serial:
            self._end(f"it came too late, the task is {self._mirror.known or 'about to end'}")
        moved_on = ""
        while self._unread and not self._is_over:
            news = self._unread.take()
            if news.change.serial >= serial or news.change.is_over:
                moved_on = self._hear(news.change, is_sure=not (news.missed or news.change.is_late))
        if moved_on and not self._is_over:  # and central does not ask for it again
            self._end(f"the task is {moved_on} by now")
        return self._is_over

    def _hear(self, change: StateChange, *, is_sure: bool) -> str:
        """A change that came after it, or it itself. The state to which the server has gone without
        a word of it.
        """
        effects = {
            one.effect
            for one in self._life_cycle.transitions
            if (one.name, one.target) == (change.transition, change.state)
        }
        is_waiting = self._life_cycle.grant(change.state) is not None
        if change.is_over:
            self._end(
                f"the task is {change.state or 'over'}"
                + (f": {change.text}" if change.text else "")
            )
        elif not is_sure and not is_waiting:
            self._end(
                ""
                if change.goal == self._goal
                else "changes were missed, and it is not the task's goal"
            )
        elif Effect.TAKE_GOAL in effects or (
            change.transition == "restarted" and not self._is_granted
        ):
            self._end()
        elif Effect.REFUSE in effects:
            self._end(change.text or "its handler gives no reason")
        elif change.transition == "restarted":
            self._end("its handler was called again, without it")
        elif change.by is Party.CLIENT and (change.transition, change.state) != (
            self._row.name,
            self._row.target,
        ):
            self._end(f"'{change.transition}' came after it")
        elif not (change.by is Party.CLIENT or is_waiting):
            return change.state
        return ""

    @property
    def _is_granted(self) -> bool:
        """Whether there is a transition by which the server takes it over."""
        return self._life_cycle.grant(self._row.target) is not None
