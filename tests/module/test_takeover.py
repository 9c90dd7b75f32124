"""Two copies of one program, of which the second takes over: what both say is said once."""

from collections.abc import Callable

import pytest

from tca_module import Client, Command, Condition, ExceptionHandler, Failure, Module, Task, connect
from tca_module.testing import LocalCentral

MOVE = Command("move", int)
SLIP = Failure("slip", int)
RECOVER = ExceptionHandler("recover", int)
CHECK = Command("check", int)
SOON = 5.0


@pytest.fixture
def legs(central: LocalCentral) -> Module:
    legs = Module("legs", central)

    @legs.handles(MOVE)
    def move(_: Task, leg: int) -> None:
        if leg == 0:
            raise SLIP(leg)

    return legs


def expert(central: LocalCentral, asked: list[int]) -> Module:
    """It allows two tries more."""
    module = Module("expert", central)

    @module.at_start
    def begin(started: Module) -> None:
        started.on_failure(SLIP, RECOVER, of=MOVE, maximum=2)

    @module.handles(RECOVER)
    def recover(task: Task, _: int) -> None:
        asked.append(task.trouble.invocations)
        task.trouble.failing.retry()

    return module


def watcher(central: LocalCentral, heard: list[int]) -> tuple[Module, Callable[[], None]]:
    """It hears of moves until it has had enough."""
    module = Module("watcher", central)
    taps = []

    @module.at_start
    def begin(started: Module) -> None:
        taps.append(started.tap(Condition.BEFORE_HANDLING, MOVE, CHECK))

    @module.handles(CHECK)
    def check(_: Task, leg: int) -> None:
        heard.append(leg)

    def has_enough() -> None:
        taps[0].remove()

    return module, has_enough


def test_an_exception_handler_is_called_so_often_however_many_copies_attached_it(
    central: LocalCentral, legs: Module, user: Client
) -> None:
    asked: list[int] = []

    def tries() -> list[int]:
        asked.clear()
        user.command(MOVE, 0).wait(SOON)
        return asked[:]

    with legs.running(), expert(central, asked).running():
        assert tries() == [1, 2]
        with expert(central, asked).running():
            assert tries() == [1, 2]
        assert tries() == [1, 2]


def test_a_wiretap_ends_with_the_last_copy_that_wants_it(central: LocalCentral, legs: Module, user: Client) -> None:
    heard: list[int] = []
    first, enough_for_first = watcher(central, heard)
    second, enough_for_second = watcher(central, heard)

    def hears() -> bool:
        heard.clear()
        user.command(MOVE, 1).wait(SOON)
        return bool(heard)

    with legs.running(), first.running():
        with second.running():
            enough_for_second()
            assert hears()
        enough_for_first()
        assert not hears()


def test_what_a_restarted_central_has_forgotten_is_not_removed_from_somebody_else(
    central: LocalCentral, legs: Module, user: Client
) -> None:
    """Numbers begin anew: the old one may be that of another exception handler."""
    with legs.running(), connect("other", central) as other:
        old, number = other.on_failure(None, ExceptionHandler("shrug")), 1
        assert old.id == number
        central.restart("again")
        assert user.on_failure(SLIP, RECOVER).id == number
        old.remove()
        assert [one["id"] for one in user.status("attached")["exception_handlers"]] == [number]


def test_a_copy_that_is_gone_holds_no_wiretap(central: LocalCentral, legs: Module, user: Client) -> None:
    heard: list[int] = []
    first, enough_for_first = watcher(central, heard)
    second, _ = watcher(central, heard)
    with legs.running(), first.running():
        with second.running():
            pass
        enough_for_first()
        user.command(MOVE, 1).wait(SOON)
        assert heard == []
