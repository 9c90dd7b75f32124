"""What one has of a resource that was locked or reserved."""

from types import TracebackType
from typing import Self

from tca_module.errors import LockLost, Timeout
from tca_module.link.connection import ACKNOWLEDGED_WITHIN, Connection
from tca_wire.packets.headers import Lock
from tca_wire.vocabulary import Outcome


class Claim:
    """A lock or reservation of a resource. A ``with`` block releases it at its end, and raises LockLost there if it had
    been taken away, unless another error leaves the block.
    """

    def __init__(self, connection: Connection, header: Lock) -> None:
        self._connection = connection
        kind = "reservation" if header.reserve else "lock"
        self._what = f"the {kind} of resource '{header.resource}'" + (f" of '{header.module}'" * bool(header.module))
        self._request = connection.request(header, wants_answer=True, is_awaited=True)
        self._is_over = False

    def __repr__(self) -> str:
        return self._what

    def wait(self, timeout: float | None) -> None:
        """Wait until it is granted; central knows the timeout and says when it is over."""
        connection, request = self._connection, self._request
        is_over = connection.wait(request, timeout, self._what)
        if not is_over and not connection.silence:  # central, which knows when the time is over, is about to say so
            is_over = connection.wait(request, ACKNOWLEDGED_WITHIN, self._what)
        if not is_over:
            self._connection.abandon(self._request)
            advice = self._connection.silence or "central does not say so: it is overloaded"
            raise Timeout(f"{self._what} was not granted within {timeout:g} s: {advice}")
        answer, _ = self._request.answers[-1]
        if answer.outcome is not Outcome.DONE:
            self._is_over = True
            raise Timeout(f"{self._what} was not granted within {timeout:g} s: {answer.text}")

    @property
    def held(self) -> bool:
        """Whether one has it still, as far as is known here: not after ``release()``, nor once it was taken away or
        central was restarted. Never waits: long work looks at it before each step that counts on the lock.
        """
        return not (self._is_over or self._connection.is_taken(self._request))

    def release(self) -> None:
        """Let others in again. Does nothing if it was released, or has ended with its task. Raises LockLost if it had
        been taken away, CentralLost if central, who would know, does not answer; it is released when it does.
        """
        if not self._is_over:
            self._connection.check_thread()  # refused in another thread, it can be released in its own
            self._is_over = True
            self._connection.release(self._request, self._what)
            if self._request.taken:
                raise self._lost()

    def _lost(self) -> LockLost:
        how = self._request.taken or "central does not know it any more: the connection was broken"
        return LockLost(f"{self._what} was lost before it was released: {how}; others may have been let in")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if not self._is_over:
            self._connection.check_thread()  # refused in another thread, it can be released in its own
            self._is_over = True
            has_failed = error is not None
            if not self._connection.release(self._request, self._what, at_once=has_failed) and not has_failed:
                raise self._lost()
