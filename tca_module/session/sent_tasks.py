"""Tasks that are sent without waiting for central's word: their ids, and the errors of those that
are refused.
"""

from typing import Any, Protocol, Self

from tca_module.session.epoch_numbers import EpochNumber
from tca_module.session.request import Request


class _Session(Protocol):
    epoch: str


class Acknowledging(Protocol):
    """A connection on which tasks are sent."""

    @property
    def session(self) -> _Session:
        """The present central's."""

    def acknowledged(self, request: Request) -> EpochNumber:
        """The id of a task that was sent. Waits for it; raises the error that the send came to."""


class SentId(EpochNumber):
    """The id of a task that was sent. Before central has told it, whoever looks at it waits; in
    headers the request that has sent the task stands for it.
    """

    connection: Acknowledging
    request: Request

    def __new__(cls, connection: Acknowledging, request: Request) -> Self:
        """*request* has sent the task on *connection*."""
        self = int.__new__(cls, 0)
        self.connection, self.request = connection, request
        return self

    @property
    def known(self) -> EpochNumber:
        """The id itself. Waits for it; raises the error that the send came to."""
        request = self.request
        return (
            request.accepted
            if request.accepted is not None
            else self.connection.acknowledged(request)
        )

    @property
    def on_wire(self) -> int:
        """The number by which central knows the task when it comes on the connection that has sent
        it.
        """
        request = self.request
        return int(request.accepted) if request.accepted is not None else -request.header.number

    @property
    def epoch(self) -> str:  # type: ignore[override]
        """Of the central that it was sent to."""
        return str(self.request.epoch or self.connection.session.epoch)

    @property
    def what(self) -> str:  # type: ignore[override]
        """The task, for people."""
        return str(
            self.request.accepted.what if self.request.accepted is not None else self.request.what
        )

    def be_nameable(self, connection: object) -> None:
        """Be sure that the task can be named on *connection*: another than its own knows its id
        only. Raises the error that the send came to.
        """
        if self.request.is_over or self.connection is not connection:
            self.known  # noqa: B018

    def __int__(self) -> int:
        return int(self.known)

    __index__ = __int__

    def __bool__(self) -> bool:
        return True

    def __eq__(self, other: object) -> bool:
        if isinstance(other, SentId):
            return self.request is other.request
        return other != 0 and self.known == other  # 0 is no task, whatever central says

    def __ne__(self, other: object) -> bool:
        return not self == other

    def __hash__(self) -> int:
        return hash(self.known)

    def __lt__(self, other: int) -> bool:
        return self.known < other

    def __le__(self, other: int) -> bool:
        return self.known <= other

    def __gt__(self, other: int) -> bool:
        return self.known > other

    def __ge__(self, other: int) -> bool:
        return self.known >= other

    def __repr__(self) -> str:
        return repr(self.known)

    def __format__(self, spec: str) -> str:
        return format(self.known, spec)

    def __reduce_ex__(self, _: Any) -> Any:
        known = self.known
        return EpochNumber, (int(known), known.epoch, known.what)


class TaskSends:
    """The tasks that were sent without waiting: those that were refused, until the errors are
    raised, by the delivery whose handler has sent them (0: code outside of handlers).
    """

    def __init__(self) -> None:
        self.untold = 0  #: number of those of which central has said nothing yet
        self.lost: list[
            Request
        ] = []  #: those that were lost with central, and of which nobody has asked since
        self.failed: dict[int, list[Request]] = {}  #: those that were refused, by origin
        self._known: dict[int, int] = {}  #: how many refusals the handler of a delivery knows

    def add(self, request: Request) -> None:
        """A send was refused."""
        self.failed.setdefault(request.header.origin, []).append(request)

    def check(self, origin: int | None) -> None:
        """Raise the first error of what was sent for *origin*, with notes of the others."""
        if not self.failed or origin is None or not (failed := self.failed.pop(origin, [])):
            return
        self._note(failed)
        try:
            failed[0].check(failed[0].what)
        except Exception as error:
            for other in failed[1:]:
                error.add_note(other.why_failed)
            raise

    def discard(self, request: Request) -> None:
        """The error of a send is about to be raised, if there is one."""
        if request in self.lost:
            self.lost.remove(request)
        failed = self.failed.get(request.header.origin, [])
        if request in failed:
            failed.remove(request)
            self._note([request])

    def _note(self, failed: list[Request]) -> None:
        if origin := failed[0].header.origin:
            self._known[origin] = self._known.get(origin, 0) + len(failed)

    def end(self, delivery: int) -> tuple[int, list[str]]:
        """A handler has ended: how many refusals it knows, and errors that were not raised in
        it.
        """
        if not (self._known or self.failed):
            return 0, []
        return self._known.pop(delivery, 0), [
            one.why_unheard for one in self.failed.pop(delivery, [])
        ]

    def forget(self) -> None:
        """Central was restarted, and has forgotten all deliveries: it may use the same numbers
        again.
        """
        self.failed = {origin: failed for origin, failed in self.failed.items() if not origin}
        self._known.clear()
