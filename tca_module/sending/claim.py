"""Locks and reservations of resources, for the program that requested them."""

from typing import Self

from tca_module.checks import OnlyBlocking
from tca_module.errors import LockLost, Timeout
from tca_module.link.connection import ACKNOWLEDGED_WITHIN, Connection
from tca_wire.packets.headers import Lock
from tca_wire.vocabulary import Outcome


class Claim(OnlyBlocking):
    """A lock or reservation of a resource, granted by ``lock()`` or ``reserve()``.

    The end of the ``with`` block releases the claim. If the claim was taken away before, the end of
    the block raises LockLost, unless another error leaves the block.

    Example::

        with task.lock("arm", timeout=5.0) as claim:
            while claim.held and not is_done():
                step()
    """

    def __init__(self, connection: Connection, header: Lock) -> None:
        self._connection = connection
        kind = "reservation" if header.reserve else "lock"
        where = f" of '{header.module}'" if header.module else ""
        self._what = f"the {kind} of resource '{header.resource}'{where}"
        self._request = connection.request(header, wants_answer=True, is_awaited=True)
        self._is_released = False

    def __repr__(self) -> str:
        return self._what

    def wait(self, timeout: float | None) -> None:
        """Wait until the claim is granted. Central knows the timeout, and answers in time.

        Args:
            timeout: the most seconds to wait; None waits for ever.

        Raises:
            Timeout: the claim was not granted in time.
        """
        connection, request = self._connection, self._request
        is_over = connection.wait(request, timeout, self._what)
        # Central times the wait, too, so its answer is on its way: granted, or not.
        if not is_over and not connection.why_silent:
            is_over = connection.wait(request, ACKNOWLEDGED_WITHIN, self._what)
        if not is_over:
            connection.abandon(request)
            why = connection.line.why_late(timeout or 0.0)
            raise Timeout(f"{self._what} was not granted within {timeout:g} s, {why}")
        answer, _ = request.answers[-1]
        if answer.outcome is not Outcome.DONE:
            self._is_released = True
            raise Timeout(f"{self._what} was not granted within {timeout:g} s: {answer.text}")

    @property
    def held(self) -> bool:
        """Whether the claim still holds, as far as this program knows. Never waits.

        Check it before each step that relies on the claim.
        """
        return not (self._is_released or self._connection.is_lock_lost(self._request))

    def release(self) -> None:
        """Release the claim. Releasing it again does nothing.

        Raises:
            LockLost: the claim was taken away before.
            CentralLost: central does not answer. The release is sent again when it does.
            MisuseError: another thread made the claim.
        """
        if not self._release() and self._request.why_lock_lost:
            raise self._lost_error()

    def _lost_error(self) -> LockLost:
        """Return the LockLost for this claim."""
        unknown = "central does not know it any more: the connection was broken"
        why = self._request.why_lock_lost or unknown
        text = f"{self._what} was lost before it was released: {why}; others may have used it"
        return LockLost(text)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if not self._release(at_once=error is not None) and error is None:
            raise self._lost_error()

    def _release(self, *, at_once: bool = False) -> bool:
        """Release the claim. Returns True if it still held, or had been released before."""
        if self._is_released:
            return True
        # Check before the claim counts as released, so that its own thread can still release it.
        self._connection.check_thread()
        self._is_released = True
        return self._connection.release(self._request, self._what, at_once=at_once)
