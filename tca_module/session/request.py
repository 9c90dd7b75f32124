"""One request to central and its answers; and the kinds of requests."""

from collections import deque
from collections.abc import Callable
from typing import Any

from tca_module.errors import CentralLost, Deadlock, FormatRefused, MisuseError, Refused, TcaError
from tca_module.session.epoch_numbers import EpochNumber, forgotten_text
from tca_module.session.lasting_attachments import is_lasting
from tca_wire.packets import headers
from tca_wire.packets.changes import Observe
from tca_wire.packets.codec import misfit
from tca_wire.packets.headers import Register, Send, SetVariable, ToCentral
from tca_wire.points import ROOT, TaskId
from tca_wire.vocabulary import Outcome, Refusal

_KINDS = {Refusal.FORMAT: FormatRefused, Refusal.DEADLOCK: Deadlock}

_ABOUT_CENTRAL = (
    headers.Ask | headers.Inspect | headers.GetVariable | headers.WaitUntilHandled | Observe
)
"""Questions about the present state. They mean the same after a restart of central."""

HARMLESS = _ABOUT_CENTRAL | headers.AwaitPoint | headers.Lock
"""Requests that may be made twice: the second one changes nothing."""

WAITS_FOR_OTHERS = Send | headers.AwaitPoint | headers.Lock | headers.WaitUntilHandled | Observe
"""Requests that central answers when other modules have done something."""

_WITHOUT_TASKS = (
    Register,
    headers.Unregister,
    headers.Ask,
    headers.GetVariable,
    SetVariable,
    headers.WaitUntilHandled,
    headers.Unlock,
    headers.GoOn,
    headers.EndCentral,
)
"""Requests that any central understands, whatever it remembers."""


class Request:
    """A numbered request and its answers.

    A request is over when central has accepted it, when its last answer has arrived, or when it was
    refused or lost with central's memory. If central did not send a query, because its message has
    no handler, the request is accepted with id 0.
    """

    __slots__ = (
        "__weakref__",
        "accepted",
        "after",
        "answers",
        "answers_seen",
        "body",
        "epoch",
        "forgotten_subject",
        "header",
        "is_announced",
        "is_over",
        "notify",
        "on_over",
        "refused",
        "sender_name",
        "statements_before",
        "wake",
        "wants_answer",
        "was_repeated",
        "was_sent",
        "what",
        "why_lock_lost",
        "why_lost",
    )

    def __init__(self, header: Any, body: bytes, *, wants_answer: bool) -> None:
        self.header = header
        self.body = body
        self.wants_answer = wants_answer  #: an Answer follows Accepted, and ends the request
        self.was_sent = False  #: central may have received the request
        self.epoch = ""  #: the epoch of the central that the request was sent to last
        self.was_repeated = False  #: the request was sent more than once
        self.is_over = False
        self.answers_seen = 0  #: number of answers since it was sent, without the final answer
        #: central knows that the sender, which did not wait at first, now waits for the answer
        self.is_announced = False
        self.accepted: EpochNumber | None = None  #: the id of the resulting task or message
        self.answers: deque[tuple[headers.Answer, bytes]] = deque()
        self.refused: headers.Refused | None = None
        self.why_lost = ""  #: how the request was lost with central's memory
        #: the name of the object of the request, if a restarted central has forgotten the object
        self.forgotten_subject = ""
        self.why_lock_lost = ""  #: how the lock that the request was granted was lost
        # The next three are for tasks and changes that were sent without waiting for central.
        self.what = ""  #: the name of the task or change, for people
        self.sender_name = ""  #: the message whose handler has sent the task or change
        self.after: list[TaskId] = []  #: the siblings before the task, until it is accepted
        self.statements_before = 0  #: number of statements that were sent before the request
        #: called soon after each answer, and soon after the request is over
        self.notify: Callable[[], None] | None = None
        #: called like *notify*; wakes the coroutines that await the request
        self.wake: Callable[[], None] | None = None
        #: called by the session at once when the request is over
        self.on_over: Callable[[Request], None] | None = None

    @property
    def is_unannounced(self) -> bool:
        """Whether the request is open, and must be announced if its sender now waits."""
        header = self.header
        if self.is_over or self.is_announced or not isinstance(header, Send):
            return False
        if self.what:
            return header.quiet
        return self.wants_answer and not self.answers and not header.blocking

    @property
    def waits_for_others(self) -> bool:
        """Whether the answer comes only when other modules have done something."""
        return self.wants_answer and isinstance(self.header, WAITS_FOR_OTHERS)

    @property
    def is_ended_by_kill(self) -> bool:
        """Whether a kill ended the request."""
        is_refused = self.refused is not None and self.refused.refusal is Refusal.TOO_LATE
        return is_refused or (bool(self.answers) and self.answers[-1][0].outcome is Outcome.KILLED)

    @property
    def has_failed(self) -> bool:
        """Whether the request was refused or lost."""
        return self.is_over and (self.refused is not None or bool(self.why_lost))

    @property
    def why_failed(self) -> str:
        """The error of the request in words; "" without an error."""
        try:
            self.check(self.what)
        except TcaError as error:
            return str(error)
        return ""

    @property
    def error_for_log(self) -> str:
        """The error of the request for the log, for a sender that did not receive the error."""
        if not self.sender_name:
            return self.why_failed
        advice = "reading the '.id' of a sent task raises its error in the handler"
        error = f"the handler of {self.sender_name} ended before this error: {self.why_failed}"
        return f"{error}; {advice}"

    def check(self, what: object) -> None:
        """Raise the error of the request, if any. *what* names the request."""
        if self.refused is not None:
            kind = _KINDS.get(self.refused.refusal, Refused)
            raise kind(str(what), self.refused.refusal, self.refused.text)
        if self.forgotten_subject:
            raise CentralLost(forgotten_text(self.forgotten_subject))
        if self.why_lost:
            advice = "start again" if refers_to_tasks(self.header) else "ask again"
            if isinstance(self.header, headers.AwaitPoint):
                advice = "send the task again"
            raise CentralLost(f"{what} is lost: {self.why_lost}; {advice}")


def is_for_any_central(header: Any) -> bool:
    """Return whether a request changes nothing, and any central can answer it."""
    if isinstance(header, Register):
        return not header.handlers
    return not refers_to_tasks(header) and isinstance(header, _ABOUT_CENTRAL)


def refers_to_tasks(header: Any) -> bool:
    """Return whether a request makes sense only to the central that knows its tasks."""
    watch = getattr(header, "watch", None)
    if watch is not None and watch.until is not None:
        return True
    if isinstance(header, Send):
        return bool(header.origin or header.parent or header.constraints)
    if isinstance(header, headers.Lock):
        return bool(header.origin)
    if isinstance(header, headers.Inspect):
        return header.task != ROOT
    if isinstance(header, Observe):
        return bool(header.task or header.below)
    return not isinstance(header, _WITHOUT_TASKS) and not is_lasting(header)


def check_fields(header: ToCentral) -> None:
    """Raise MisuseError for a field of the wrong type: central could not even read the header."""
    try:
        wrong = misfit(header)
    except UnicodeEncodeError as error:
        raise MisuseError(f"{error.object!r:.60} is not text that can be sent") from None
    if wrong:
        raise MisuseError(f"an option can't be sent: {wrong}")
