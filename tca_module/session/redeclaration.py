"""Repeats to a restarted central everything that it has forgotten, in order.

First come the messages, then the exception handlers and wiretaps, oldest first. Then the module
waits until the messages that it requires have handlers. Only then does it declare its own handlers,
because other modules may rely on its attachments. A refused request is logged and tried again.
"""

from collections.abc import Callable
from typing import Any

from tca_module.session.epoch_numbers import RESTARTED
from tca_module.session.lasting_attachments import LastingAttachment, LastingAttachments
from tca_module.session.registering import register_headers
from tca_module.session.request import Request
from tca_wire.packets import headers
from tca_wire.packets.parts import MessageFormat

RETRY_AFTER = 5.0  # seconds until a refused request is tried again
LOGGED_AFTER = 5.0  # seconds of waiting for required messages before this is logged
_NEVER = float("inf")

Ask = Callable[..., Request]
"""The type of ``Session.request``."""


class Redeclaration:
    """Declares everything to a restarted central.

    Only one connection of a module does this: the one that declares the module's handlers.
    """

    def __init__(
        self,
        attachments: LastingAttachments,
        ask: Ask,
        log: Callable[[str], None],
        on_over: Callable[[], None],
    ) -> None:
        self.required: list[str] = []  #: messages that must have handlers before the module serves
        self.is_over = True  #: handlers may be declared
        self._attachments = attachments
        self._ask = ask
        self._log = log  #: logs a line
        self._on_over = on_over  #: called when handlers may be declared, if not at once
        self._logged: set[str] = set()
        self._reset("", {})

    def _reset(self, epoch: str, messages: dict[str, MessageFormat]) -> None:
        self._epoch, self._messages = epoch, messages
        self._unanswered = 0  #: number of unanswered requests
        self._attached = 0  #: number of attachments that were made again
        self._is_refused = False
        self._is_waiting = False  #: waits for the handlers of required messages
        self._due = _NEVER  #: when there is something to do even if central sends nothing
        self._logged.clear()

    @property
    def is_restless(self) -> bool:
        """Whether ``send_due`` may have something to do."""
        return not self.is_over or bool(self._attachments.unwanted)

    def begin(self, epoch: str, messages: dict[str, MessageFormat]) -> None:
        """Start with the central of that epoch, which knows nothing.

        If only handlers are to be declared, the redeclaration is over at once.
        """
        self._reset(epoch, messages)
        self.is_over = not (self.required or self._attachments.unknown_to(epoch))
        if not self.is_over:
            self._declare()

    def _declare(self) -> None:
        self._is_refused, self._due = False, _NEVER
        for attachment in self._attachments.unknown_to(self._epoch):
            watch = getattr(attachment.header, "watch", None)
            is_old = attachment.number.epoch != self._epoch
            if watch is not None and watch.until is not None and is_old:
                # Central has forgotten the task at whose point the monitor ends.
                self._attachments.forget(attachment, attachment.number.epoch)
                self._log(
                    f"the {attachment} is lost: {RESTARTED}, so it can't watch until {watch.until}"
                )
        unknown = self._attachments.unknown_to(self._epoch)
        formats = self._messages | {
            one.name: one for attachment in unknown for one in attachment.formats
        }
        for header in register_headers(formats.values()):
            self._request(header, "messages that were declared")
        for attachment in unknown:
            self._request(attachment.header, f"the {attachment}", attachment)

    def _request(
        self,
        header: Any,
        what: str,
        attachment: LastingAttachment | None = None,
        *,
        waits: bool = False,
    ) -> None:
        self._unanswered += 1
        request = self._ask(header, wants_answer=waits)
        request.on_over = lambda over: self._on_request_over(over, what, attachment)

    def _on_request_over(
        self, request: Request, what: str, attachment: LastingAttachment | None
    ) -> None:
        if request.why_lost:
            return  # central was restarted once more, so ``begin`` will be called
        self._unanswered -= 1
        if request.refused is not None:
            text = f"central was restarted, and refuses {what}: {request.refused.text}"
            # A later refusal of an attachment may follow from the first refusal: it is not logged.
            if not self._is_refused or attachment is None:
                again = f"tried again every {RETRY_AFTER:g} s, and no handler is declared before"
                self._log_once(f"{text}; {again}")
            self._is_refused = True
        elif attachment is not None and request.accepted is not None:
            self._attached += 1
            attachment.number = request.accepted
            if not self._attachments.is_wanted(attachment):  # removed in the meantime
                self._ask(headers.Remove(0, attachment.number))
        if not self._unanswered:
            self._continue()

    def _continue(self) -> None:
        if self._is_refused:
            return
        if self.required and not self._is_waiting:
            self._is_waiting = True
            self._request(
                headers.WaitUntilHandled(0, self.required), "what it requires", waits=True
            )
            return
        self.is_over, self._due = True, _NEVER
        if self._attached:
            self._log(
                "central was restarted: exception handlers and wiretaps attached again:"
                f" {self._attached}"
            )
        self._on_over()

    def send_due(self, now: float) -> float:
        """Make the requests that are due; return when the next requests will be due."""
        for attachment in self._attachments.pop_unwanted(self._epoch):
            self._ask(headers.Remove(0, attachment.number))
        is_answered_soon = self._unanswered > 0 and not self._is_waiting
        if self.is_over or is_answered_soon:
            return _NEVER
        if self._due == _NEVER:
            self._due = now + (RETRY_AFTER if self._is_refused else LOGGED_AFTER)
        elif now >= self._due and self._is_refused:
            self._declare()
        elif now >= self._due:
            self._due = now + LOGGED_AFTER
            names = ", ".join(f"'{name}'" for name in self.required)
            self._log_once(f"waits for handlers of {names}, which it requires; see 'tca messages'")
        return self._due

    def _log_once(self, text: str) -> None:
        if text not in self._logged:
            self._logged.add(text)
            self._log(text)
