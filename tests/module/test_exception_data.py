"""Which exception handlers may take care of which failure: those that can read its data when it comes."""

import queue
from dataclasses import dataclass
from typing import Any

import pytest

from tca_module import (
    BadFormat,
    Client,
    Command,
    ExceptionHandler,
    Failure,
    MisuseError,
    Module,
    Outcome,
    Task,
    connect,
)
from tca_module.testing import LocalCentral

SOON = 5.0
MOVE = Command("move")


@dataclass
class Contact:
    leg: int
    height: float


@dataclass
class Scrape(Contact):
    side: str


ROCK = Contact(3, 0.25)
SCRAPE = Scrape(2, 0.5, "left")

FITS: list[tuple[Any, Any, Any, Any]] = [
    (int, 3, int, 3),
    (int, 3, int | None, 3),
    (int, 3, int | str, 3),
    (int, 3, float, 3.0),
    (int | None, None, int | str | None, None),
    (int | None, 3, Any, 3),
    (Any, 3, int, 3),
    (None, None, int | None, None),
    (None, None, Contact | None, None),
    (int, 3, None, None),
    (Contact, ROCK, Contact | None, ROCK),
    (Scrape, SCRAPE, Contact, Contact(2, 0.5)),
    (Scrape, SCRAPE, Contact | None, Contact(2, 0.5)),
    (list[Scrape], [SCRAPE], list[Contact], [Contact(2, 0.5)]),
]
DIFFERS: list[tuple[Any, Any]] = [
    (int | None, int),
    (int | str, int),
    (float, int),
    (int, str),
    (None, int),
    (Contact, Scrape),
    (Contact | None, Contact),
    (list[Contact], list[Scrape]),
]


@pytest.mark.parametrize(("has", "data", "wants", "comes"), FITS, ids=str)
def test_what_may_be_declared_gets_its_data(
    legs: Module, central: LocalCentral, has: Any, data: Any, wants: Any, comes: Any
) -> None:
    collision, came = Failure("collision", has), queue.SimpleQueue[Any]()
    handler: ExceptionHandler[Any] = ExceptionHandler("raise the leg", wants)

    @legs.handles(MOVE)
    def move(_: Task) -> None:
        raise collision(data)

    if wants is None:
        legs.handles(handler)(lambda _: came.put(None))
    else:
        legs.handles(handler)(lambda _, data: came.put(data))
    with legs.running(), connect("user", central) as user:
        user.on_failure(collision, handler)
        assert user.command(MOVE).wait(SOON) is Outcome.DONE
    assert came.get(timeout=SOON) == comes


@pytest.mark.parametrize(("has", "wants"), DIFFERS, ids=str)
def test_what_could_not_read_them_is_refused(user: Client, has: Any, wants: Any) -> None:
    with pytest.raises(
        MisuseError, match=r"exception handler 'raise the leg' wants data of type .*, and failure 'collision' has"
    ):
        user.on_failure(Failure("collision", has), ExceptionHandler("raise the leg", wants))


@pytest.mark.parametrize(("has", "wants"), [(has, wants) for has, _, wants, _ in FITS])
def test_a_kind_of_a_failure_fits_the_exception_handlers_of_the_other(has: Any, wants: Any) -> None:
    Failure("scrape", has, kind_of=Failure("collision", wants))


@pytest.mark.parametrize(("has", "wants"), DIFFERS)
def test_a_kind_that_does_not_is_none(has: Any, wants: Any) -> None:
    with pytest.raises(
        BadFormat, match=r"failure 'scrape' has data of type .*, and 'collision', of which it is a kind"
    ):
        Failure("scrape", has, kind_of=Failure("collision", wants))
