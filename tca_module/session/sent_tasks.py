"""Tasks that are sent without waiting for central: their ids, and the errors of refused ones."""

from typing import Any, Protocol, Self

from tca_module.session.epoch_numbers import EpochNumber
from tca_module.session.request import Request


class _Session(Protocol):
    epoch: str


class Acknowledging(Protocol):
    """A connection on which tasks are sent."""

    @property
    def session(self) -> _Session:
        """The connection's session, which knows the epoch of the present central."""

    def wait_for_id(self, request: Request) -> EpochNumber:
        """Wait for the id of a sent task and return it; raise the error of the send."""


class SentId(EpochNumber):
    """The id of a sent task, which central may not have assigned yet.

    Reading the id waits for central. A header needs no wait: instead of the id it contains the
    number of the request that sent the task.
    """

    connection: Acknowledging
    request: Request

    def __new__(cls, connection: Acknowledging, request: Request) -> Self:
        """Create the id of the task that *request* has sent on *connection*."""
        self = int.__new__(cls, 0)
        self.connection, self.request = connection, request
        return self

    @property
    def assigned_id(self) -> EpochNumber:
        """The assigned id. Waits until central has assigned it; raises the error of the send."""
        if self.request.accepted is not None:
            return self.request.accepted
        return self.connection.wait_for_id(self.request)

    @property
    def on_wire(self) -> int:
        """The number for headers on the sending connection: the id, or minus the request number."""
        request = self.request
        return int(request.accepted) if request.accepted is not None else -request.header.number

    @property
    def epoch(self) -> str:  # type: ignore[override]
        """The epoch of the central that the task was sent to."""
        return str(self.request.epoch or self.connection.session.epoch)

    @property
    def what(self) -> str:  # type: ignore[override]
        """The task's name, for people."""
        request = self.request
        return request.what if request.accepted is None else request.accepted.what

    def check_nameable(self, connection: object) -> None:
        """Ensure that headers on *connection* can name the task. Raises the error of the send.

        On another connection than the sending one, central knows the task only by its assigned id.
        """
        if self.request.is_over or self.connection is not connection:
            self.assigned_id  # noqa: B018

    def __int__(self) -> int:
        return int(self.assigned_id)

    __index__ = __int__

    def __bool__(self) -> bool:
        return True

    def __eq__(self, other: object) -> bool:
        if isinstance(other, SentId):
            return self.request is other.request
        # Comparing with 0, which names no task, needs no wait.
        return other != 0 and self.assigned_id == other

    def __ne__(self, other: object) -> bool:
        return not self == other

    def __hash__(self) -> int:
        return hash(self.assigned_id)

    def __lt__(self, other: int) -> bool:
        return self.assigned_id < other

    def __le__(self, other: int) -> bool:
        return self.assigned_id <= other

    def __gt__(self, other: int) -> bool:
        return self.assigned_id > other

    def __ge__(self, other: int) -> bool:
        return self.assigned_id >= other

    def __repr__(self) -> str:
        return repr(self.assigned_id)

    def __format__(self, spec: str) -> str:
        return format(self.assigned_id, spec)

    def __reduce_ex__(self, _: Any) -> Any:
        assigned_id = self.assigned_id
        return EpochNumber, (int(assigned_id), assigned_id.epoch, assigned_id.what)


class TaskSends:
    """The tasks that were sent without waiting, and the errors that were not raised yet.

    Errors are sorted by the delivery whose handler sent the task (0: code outside of handlers).
    """

    def __init__(self) -> None:
        self.unacknowledged = 0  #: number of sends that central has neither accepted nor refused
        #: sends that are lost with central's memory, and whose error was not raised yet
        self.lost: list[Request] = []
        self.failed: dict[int, list[Request]] = {}  #: delivery of the sender -> refused sends
        self._known: dict[int, int] = {}  #: delivery -> number of refusals that its handler knows

    def add(self, request: Request) -> None:
        """Record that a send was refused."""
        self.failed.setdefault(request.header.origin, []).append(request)

    def check(self, origin: int | None) -> None:
        """Raise the first error of the sends for *origin*, with notes about the others."""
        if not self.failed or origin is None or not (failed := self.failed.pop(origin, [])):
            return
        self._count_known(failed)
        try:
            failed[0].check(failed[0].what)
        except Exception as error:
            for other in failed[1:]:
                error.add_note(other.why_failed)
            raise

    def discard(self, request: Request) -> None:
        """Forget the error of a send, if it has one: the caller raises it."""
        if request in self.lost:
            self.lost.remove(request)
        failed = self.failed.get(request.header.origin, [])
        if request in failed:
            failed.remove(request)
            self._count_known([request])

    def _count_known(self, failed: list[Request]) -> None:
        if origin := failed[0].header.origin:
            self._known[origin] = self._known.get(origin, 0) + len(failed)

    def pop_refusals(self, delivery: int) -> tuple[int, list[str]]:
        """Return how many refusals an ended handler knows, and its errors that were not raised."""
        if not (self._known or self.failed):  # the usual case, fast
            return 0, []
        errors = [one.error_for_log for one in self.failed.pop(delivery, [])]
        return self._known.pop(delivery, 0), errors

    def forget(self) -> None:
        """Forget the deliveries of a restarted central, which may use the same numbers again."""
        self.failed = {origin: failed for origin, failed in self.failed.items() if not origin}
        self._known.clear()
