"""Exception handlers and wiretaps that were attached, and exception handlers that are to be
attached to a new task.
"""

from typing import Any

from tca_module import checks
from tca_module.checks import check, check_handles
from tca_module.errors import CentralLost
from tca_module.link.connection import Connection
from tca_module.session.epoch_numbers import first_foreign
from tca_wire.messages.controls import ExceptionHandler
from tca_wire.messages.declarations import Failure
from tca_wire.packets import headers
from tca_wire.packets.parts import Attachment


class AttachmentRef:
    """An exception handler or wiretap that was attached; ``remove()`` takes it away. That of a
    message or of the root is attached anew when central was restarted.
    """

    def __init__(
        self, connection: Connection, number: int, header: headers.Attach | headers.Tap
    ) -> None:
        self._connection = connection
        self._attachments = connection.session.attachments
        self._standing = self._attachments.of(header)
        self._number = number  # of an attachment to a task
        self._origin = header.origin

    @property
    def id(self) -> int:
        """Its number, as in ``tca attached``; it changes when central is restarted."""
        return self._standing.number if self._standing is not None else self._number

    def remove(self) -> None:
        """Take it away for good, unless another module wants it too. Messages that it has sent
        stay.
        """
        connection = self._connection
        if self._standing is not None:
            self._attachments.forget(self._standing, connection.session.epoch)
        try:
            origin = 0 if first_foreign([self._origin], connection.session.epoch) else self._origin
            connection.call(headers.Remove(0, self.id, origin=origin), f"removing {self.id}")
        except CentralLost:
            if first_foreign([self.id], connection.session.epoch) is None:
                raise


class Recovery:
    """An exception handler of a task that is being sent: ``on_failure=[Recovery(COLLISION,
    RAISE_LEG, maximum=2)]``. It takes what ``on_failure()`` of a handle takes. Raises MisuseError
    if handler and failure do not fit.
    """

    __slots__ = ("attachment", "handler")

    def __init__(
        self,
        failure: Failure[Any] | None,
        handler: ExceptionHandler[Any],
        *,
        maximum: int | None = None,
    ) -> None:
        check_handles(failure, handler)
        check(handler.title, checks.MAXIMUM, maximum=maximum)
        self.handler = handler
        self.attachment = Attachment(
            failure.name if failure is not None else "", handler.name, maximum or 0
        )
