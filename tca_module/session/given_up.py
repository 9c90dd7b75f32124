"""Giving up requests whose answers are no longer wanted.

Central is informed. A task that central has not acknowledged is killed, because no program knows
its id.
"""

from typing import Any

from tca_module.session.request import HARMLESS, Request
from tca_module.session.session import Session
from tca_wire.packets import headers
from tca_wire.points import TaskId


def abandon(session: Session, request: Request) -> None:
    """Give up a request."""
    number, origin = request.header.number, getattr(request.header, "origin", 0)
    if isinstance(request.header, headers.Release | headers.GiveUp):
        return  # central must get this request, although nothing waits for an answer
    if session.requests.pop(number, None) is not None and request.wants_answer:
        # Central may have received the request before it went away. The GiveUp is repeated after
        # a break, as every request is.
        if request.was_sent:
            abandon_asking_why(session, request)
    elif _is_killed_if_given_up(session, request.header) and not (request.what and request.is_over):
        why = "its sender has given up waiting for its id"
        session.request(headers.Kill(0, TaskId(-number), why, origin=origin))
        if request.what:
            session.sends.unacknowledged -= 1
            request.is_over, request.why_lost = True, "it was given up"


def abandon_asking_why(session: Session, request: Request) -> Request:
    """Give up a request that took too long; return one that asks central for the reason."""
    number = request.header.number
    session.requests.pop(number, None)
    return session.request(
        headers.GiveUp(number, origin=getattr(request.header, "origin", 0)), wants_answer=True
    )


def fate_of(session: Session, request: Request) -> str:
    """Return what becomes of a request that was given up, in words."""
    if _is_killed_if_given_up(session, request.header):
        return "is killed as soon as central answers, if central received it"
    if isinstance(request.header, HARMLESS):
        return "is given up"
    return "may still be carried out, if central received it"


def _is_killed_if_given_up(session: Session, header: Any) -> bool:
    """Return whether giving up this unacknowledged request kills its task."""
    if not isinstance(header, headers.Send) or header.when_killed:
        return False
    declared = session.messages.get(header.message)
    return declared is not None and declared.message_class.is_task
