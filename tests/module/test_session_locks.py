"""What a session knows of the locks of its module."""

import pytest
from module.test_session import HELLO, hear, said, welcome, welcomed

from tca_module.session.request import Request
from tca_module.session.session import Session
from tca_wire.packets.headers import Accepted, Answer, Lock, Release, Taken, Unknown


@pytest.fixture
def session() -> Session:
    return welcomed(Session(HELLO))


def granted(session: Session) -> Request:
    """A lock that the session has got."""
    lock = session.request(Lock(0, "legs"), wants_answer=True)
    hear(session, Answer(lock.header.number))
    said(session)
    return lock


def test_a_lock_that_is_taken_away_is_known_by_its_number(session: Session) -> None:
    lock, other = granted(session), granted(session)
    hear(session, Taken(lock.header.number, "unlocked"), Taken(99, "never heard of"))
    assert (lock.taken, other.taken) == ("unlocked", "")


def test_a_restarted_central_has_forgotten_what_was_locked(session: Session) -> None:
    lock = granted(session)
    hear(session, Unknown(), welcome("two"))
    assert lock.taken == "central was restarted and has forgotten it"


def test_a_lock_is_released_also_where_the_connection_breaks_and_nobody_waits(session: Session) -> None:
    lock = granted(session)
    release = session.request(Release(0, lock.header.number))
    session.abandon(release)
    said(session)
    hear(session, Unknown(), welcome())
    assert said(session) == [release.header]
    hear(session, Accepted(release.header.number, 7))
    hear(session, Unknown(), welcome())
    assert said(session) == []
