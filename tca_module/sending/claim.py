"""Locks and reservations of resources, as those have them that asked for them."""

from typing import Self

from tca_module.errors import LockLost, Timeout
from tca_module.link.connection import ACKNOWLEDGED_WITHIN, Connection
from tca_wire.packets.headers import Lock
from tca_wire.vocabulary import Outcome


class Claim:
    """A lock or reservation. The end of a ``with`` block releases it, and raises LockLost if it had
    been taken away, unless another error leaves the block.
    """

    def __init__(self, connection: Connection, header: Lock) -> None:
        self._connection = connection
        kind = "reservation" if header.reserve else "lock"
        self._what = f"the {kind} of resource '{header.resource}'" + (
            f" of '{header.module}'" * bool(header.module)
        )
        self._request = connection.request(header, wants_answer=True, is_awaited=True)
        self._is_over = False

    def __repr__(self) -> str:
        return self._what

    def wait(self, timeout: float | None) -> None:
        """Wait until it is granted. Central knows the timeout, and says when it is over."""
        connection, request = self._connection, self._request
        is_over = connection.wait(request, timeout, self._what)
        if (
            not is_over and not connection.silence
        ):  # central, which knows when the time is over, is about to say so
            is_over = connection.wait(request, ACKNOWLEDGED_WITHIN, self._what)
        if not is_over:
            self._connection.abandon(self._request)
            why = self._connection.line.why_late(timeout or 0.0)
            raise Timeout(f"{self._what} was not granted within {timeout:g} s, {why}")
        answer, _ = self._request.answers[-1]
        if answer.outcome is not Outcome.DONE:
            self._is_over = True
            raise Timeout(f"{self._what} was not granted within {timeout:g} s: {answer.text}")

    @property
    def held(self) -> bool:
        """Whether it still holds, as far as is known here. Never waits: check it before each step
        that needs it.
        """
        return not (self._is_over or self._connection.is_taken(self._request))

    def release(self) -> None:
        """Let others in again; twice does no harm. Raises LockLost if it had been taken away,
        CentralLost if central does not answer; central is then told later.
        """
        if not self._end() and self._request.taken:
            raise self._lost()

    def _lost(self) -> LockLost:
        how = self._request.taken or "central does not know it any more: the connection was broken"
        return LockLost(
            f"{self._what} was lost before it was released: {how}; others may have been let in"
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if not self._end(at_once=error is not None) and error is None:
            raise self._lost()

    def _end(self, *, at_once: bool = False) -> bool:
        """Release it; whether it still held, or had been released."""
        if self._is_over:
            return True
        self._connection.check_thread()  # refused in another thread, it can be released in its own
        self._is_over = True
        return self._connection.release(self._request, self._what, at_once=at_once)
