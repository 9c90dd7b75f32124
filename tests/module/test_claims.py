"""Locks and reservations, as modules use them, and those that were taken away."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from module.real_central import SOON

from tca_module import (
    Client,
    Command,
    Deadlock,
    LockLost,
    MisuseError,
    Module,
    Outcome,
    Query,
    Refused,
    ResourceInfo,
    Task,
    TaskFailed,
    Timeout,
    connect,
)
from tca_module.testing import LocalCentral

MOVE = Command("move", int)
WHERE = Query("where", reply=int)
ASK = Query("ask", reply=int)


def test_while_a_resource_is_locked_nobody_gets_in(central: LocalCentral, legs: Module, user: Client) -> None:
    moved: list[int] = []
    legs.handles(MOVE)(lambda _, number: moved.append(number))
    with legs.running(), connect("other", central) as other:
        with user.lock("legs", timeout=5):
            move = other.command(MOVE, 1)
            with pytest.raises(Timeout, match="not reached"):
                move.wait(timeout=0.1)
            assert [resource.locked_by for resource in resources(user)] == ["user"]
            with pytest.raises(Deadlock, match="legs, which user has locked"):
                user.command(MOVE, 2).result()
        move.result(timeout=5)
        assert [resource.locked_by for resource in resources(user)] == [""]


def resources(user: Client) -> list[ResourceInfo]:
    return [resource for module in user.modules() for resource in module.resources]


def test_a_reservation_lets_in_what_its_module_sends(central: LocalCentral, legs: Module, user: Client) -> None:
    moved: list[int] = []
    legs.handles(MOVE)(lambda _, number: moved.append(number))
    with legs.running(), connect("other", central) as other:
        claim = user.reserve("legs", "legs")
        late = other.command(MOVE, 2)
        user.command(MOVE, 1).result(timeout=5)
        assert moved == [1]
        claim.release()
        claim.release()
        late.result(timeout=5)
        assert moved == [1, 2]


def test_a_handler_gets_its_own_answer_when_it_has_released_its_own_resource(
    central: LocalCentral, legs: Module, user: Client
) -> None:
    legs.handles(WHERE)(lambda *_: 7)

    @legs.handles(ASK)
    def ask(task: Task, _: None) -> int:
        with task.lock("legs", timeout=5):
            where = task.query_send(WHERE)
        return where.receive(timeout=5)

    with legs.running():
        assert user.query(ASK, timeout=10) == 7


def test_whoever_waits_too_long_is_told_who_has_it(central: LocalCentral, legs: Module, user: Client) -> None:
    legs.handles(MOVE)(lambda *_: None)
    with legs.running(), connect("other", central) as other:
        with user.lock("legs"):
            with pytest.raises(Timeout, match="legs, which user has locked"):
                other.lock("legs", timeout=0.05)
            with pytest.raises(Timeout, match="lock of resource 'legs' of 'legs'"):
                other.lock("legs", "legs", timeout=0)
            with pytest.raises(Refused, match="release it"):
                user.reserve("legs")
        with other.reserve("legs", timeout=0):
            pass


@pytest.mark.parametrize("in_block", [False, True])
def test_a_release_that_is_refused_in_another_thread_loses_no_lock(
    central: LocalCentral, legs: Module, user: Client, in_block: bool
) -> None:
    legs.handles(MOVE)(lambda *_: None)
    refused: list[MisuseError] = []
    with legs.running(), connect("other", central) as other:
        claim = user.lock("legs", timeout=5)

        def release() -> None:
            try:
                if in_block:
                    with claim:
                        pass
                else:
                    claim.release()
            except MisuseError as error:
                refused.append(error)

        thread = threading.Thread(target=release)
        thread.start()
        thread.join()
        assert "belongs to the one that opened it" in str(refused[0])
        assert claim.held
        claim.release()
        other.lock("legs", timeout=5).release()


# --- A lock or reservation that was taken away -----------------------------------------------------------------------


pytestmark = pytest.mark.usefixtures("attentive")

SCAN = Command("scan")


class Scans:
    """Scans, for which the legs must stand still: each waits in its block until it may go on."""

    def __init__(self, eyes: Module) -> None:
        self.held: list[bool] = []
        self._locked, self._go_on = threading.Event(), threading.Event()
        eyes.handles(SCAN)(self._scan)

    def _scan(self, task: Task) -> None:
        with task.lock("legs", timeout=SOON) as claim:
            self.held.append(claim.held)
            self._locked.set()
            assert self._go_on.wait(SOON)
            self.held.append(claim.held)
        self.held.append(claim.held)

    @contextmanager
    def under_way(self) -> Iterator[None]:
        """While a scan has the legs."""
        assert self._locked.wait(SOON)
        try:
            yield
        finally:
            self._go_on.set()


@pytest.fixture
def moving(legs: Module) -> Iterator[None]:
    legs.handles(MOVE)(lambda *_: None)
    with legs.running():
        yield


def taken_away(central: LocalCentral) -> None:
    with connect("operator", central) as operator:
        assert operator.unlock("legs")


@pytest.mark.usefixtures("moving")
def test_a_handler_whose_lock_was_taken_away_fails_at_the_end_of_its_block(eyes: Module, user: Client) -> None:
    scans = Scans(eyes)
    with eyes.running():
        scan = user.command(SCAN)
        with scans.under_way():
            assert user.unlock("legs")
            assert user.command(MOVE, 1, sequential=False).wait(SOON) is Outcome.DONE
        with pytest.raises(
            TaskFailed, match=r"lock of resource 'legs' was lost .* unlocked by module 'user'"
        ) as raised:
            scan.result(SOON)
    assert raised.value.failure == "lock lost"
    assert scans.held == [True, False]


@pytest.mark.usefixtures("moving")
def test_an_error_that_leaves_the_block_is_not_replaced(eyes: Module, user: Client, central: LocalCentral) -> None:
    @eyes.handles(SCAN)
    def scan(task: Task) -> None:
        with task.lock("legs"):
            taken_away(central)
            raise KeyError("dust")

    with eyes.running(), pytest.raises(TaskFailed, match="dust"):
        user.command(SCAN).result(SOON)


@pytest.mark.usefixtures("moving")
def test_who_releases_without_a_block_is_told_once(eyes: Module, user: Client, central: LocalCentral) -> None:
    @eyes.handles(SCAN)
    def scan(task: Task) -> None:
        claim = task.reserve("legs")
        taken_away(central)
        with pytest.raises(LockLost, match="the reservation of resource 'legs' was lost before it was released"):
            claim.release()
        claim.release()

    with eyes.running():
        assert user.command(SCAN).wait(SOON) is Outcome.DONE


@pytest.mark.usefixtures("moving")
def test_the_connection_broke_inside_the_block(user: Client, central: LocalCentral) -> None:
    """Central frees what those had who are gone, if only for a moment: others have been let in."""
    with connect("other", central) as other:
        claim = other.lock("legs")
        central.cut("other")
        assert user.command(MOVE, 1).wait(SOON) is Outcome.DONE
        other.modules()
        assert not claim.held
        with pytest.raises(LockLost, match="the connection to central was lost"):
            claim.release()
        with pytest.raises(LockLost, match="the connection to central was lost"), other.lock("legs"):
            central.cut("other")


def test_the_module_of_the_resource_is_gone(user: Client, legs: Module) -> None:
    legs.handles(MOVE)(lambda *_: None)
    with legs.running():
        claim = user.lock("legs")
    assert not claim.held
    with pytest.raises(LockLost, match="module 'legs' has gone"), claim:
        pass


@pytest.mark.usefixtures("moving")
def test_central_was_restarted_inside_the_block(user: Client, central: LocalCentral) -> None:
    """A client learns it when it next says something: at the end of the block at the latest."""
    with pytest.raises(LockLost, match="central was restarted and has forgotten it"), user.lock("legs"):
        central.restart("afresh")
    with connect("other", central) as other:
        other.wait_until_handled(MOVE, timeout=SOON)
        with other.lock("legs", timeout=SOON) as claim:
            assert claim.held
