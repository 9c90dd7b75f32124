"""Requests whose answers are not waited for any more. Central is told; a task of which it has not
spoken is killed.
"""

from typing import Any

from tca_module.session.request import HARMLESS, Request
from tca_module.session.session import Session
from tca_wire.packets import headers
from tca_wire.points import TaskId


def abandon(session: Session, request: Request) -> None:
    """Give a request up without a question."""
    number, origin = request.header.number, getattr(request.header, "origin", 0)
    if isinstance(request.header, headers.Release | headers.GiveUp):
        return  # central is to hear it all the same
    if request.path is not None:
        request.path.abandon(request)
    elif session.requests.pop(number, None) is not None and request.wants_answer:
        if (
            request.was_sent
        ):  # central may have it, also if it is away now: the GiveUp is repeated like all else
            ask_why(session, request)
    elif _is_recalled(session, request.header) and not (request.what and request.is_over):
        why = "its sender has given it up, and does not know it"
        session.request(headers.Kill(0, TaskId(-number), why, origin=origin))
        if request.what:
            session.sends.untold -= 1
            request.is_over, request.lost = True, "it was given up"


def ask_why(session: Session, request: Request) -> Request | None:
    """Give up a request that took too long; the request that asks central why, None for a direct
    one.
    """
    if request.path is not None:
        request.path.abandon(request)
        return None
    number = request.header.number
    session.requests.pop(number, None)
    return session.request(
        headers.GiveUp(number, origin=getattr(request.header, "origin", 0)), wants_answer=True
    )


def fate_of(session: Session, request: Request) -> str:
    """The fate of a request that was given up, in words."""
    if _is_recalled(session, request.header):
        return "is killed as soon as central answers, if it had heard of it"
    if isinstance(request.header, HARMLESS):
        return "is given up"
    return "may yet be done, if central had heard of it"


def _is_recalled(session: Session, header: Any) -> bool:
    """Whether a request that is given up unheard is killed: a task is, since only its sender could
    find it.
    """
    if not isinstance(header, headers.Send) or header.when_killed:
        return False
    declared = session.messages.get(header.message)
    return declared is not None and declared.message_class.is_task
