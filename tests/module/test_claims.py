"""Locks and reservations, as modules use them."""

import threading

import pytest

from tca_module import (
    Client,
    Command,
    Deadlock,
    MisuseError,
    Module,
    Query,
    Refused,
    ResourceInfo,
    Task,
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
