"""Exception handlers and wiretaps that were attached, and recoveries for a task being sent."""

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
    """An exception handler or wiretap that was attached; ``remove()`` removes it.

    After a restart of central, the library reattaches the attachments to messages and to the root.
    """

    def __init__(
        self, connection: Connection, number: int, header: headers.Attach | headers.Tap
    ) -> None:
        self._connection = connection
        self._attachments = connection.session.attachments
        self._lasting = self._attachments.find(header)
        self._number = number  # the id of an attachment to a task
        self._origin = header.origin

    @property
    def id(self) -> int:
        """The attachment's number, as in ``tca attached``. A restart of central changes it."""
        return self._lasting.number if self._lasting is not None else self._number

    def remove(self) -> None:
        """Remove the attachment for good.

        If another module has attached the same, that module's attachment stays. Messages that
        central has sent because of the attachment are not affected.

        Raises:
            CentralLost: central does not answer.

        Example::

            tap = user.tap(Condition.WHEN_SENT, MOVE_LEG, LOG_LINE)
            tap.remove()
        """
        connection = self._connection
        if self._lasting is not None:
            self._attachments.forget(self._lasting, connection.session.epoch)
        try:
            # An origin from before a restart of central names nothing in the new central.
            origin = 0 if first_foreign([self._origin], connection.session.epoch) else self._origin
            connection.call(headers.Remove(0, self.id, origin=origin), f"removing {self.id}")
        except CentralLost:
            # Also raised if a restarted central has forgotten the attachment, which is then gone.
            if first_foreign([self.id], connection.session.epoch) is None:
                raise


class Recovery:
    """An exception handler of a task that is being sent, for the option ``on_failure=``.

    Args:
        failure: the failure that *handler* handles; None for any failure.
        handler: the ExceptionHandler.
        maximum: how often *handler* may be called for the task. Default: None, any number.

    Raises:
        MisuseError: *handler* cannot accept the data of *failure*.

    Example::

        task.command(MOVE_LEG, 3, on_failure=[Recovery(COLLISION, RAISE_LEG, maximum=2)])
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
