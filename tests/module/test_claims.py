"""Locks and reservations, as modules use them."""

import threading

import pytest

from tca_module import (
    Client,
    Command,
    Deadlock,
    Goal,
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
from tca_wire.journal import facts

MOVE = Command("move", int)
WHERE = Query("where", reply=int)
ASK = Query("ask", reply=int)
REST = Goal("rest")
TIDY = Goal("tidy", int)


def test_while_a_resource_is_locked_nobody_gets_in(central: LocalCentral, legs: Module, user: Client) -> None:
    moved: list[int] = []
    legs.handles(MOVE)(lambda _, number: moved.append(number))
    with legs.running(), connect("other", central) as other:
        with user.lock("legs", timeout=5):
            move = other.command(MOVE, 1)
            with pytest.raises(Timeout, match="not reached"):
                move.wait(timeout=0.1)
            assert [resource.locked_by for resource in resources(user)] == ["user"]
            with pytest.raises(Deadlock, match="'legs' is locked by module 'user'"):
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


def test_a_handler_keeps_what_it_locked_until_its_task_has_ended(central: LocalCentral, user: Client) -> None:
    legs, planner, eyes = (Module(name, central=central) for name in ("legs", "planner", "eyes"))
    go_on = threading.Event()
    order: list[str] = []

    @planner.handles(TIDY)
    def tidy(task: Task, _: int) -> None:
        task.lock("legs")
        task.goal(REST)

    @eyes.handles(REST)
    def rest(_: Task) -> None:
        go_on.wait(10)
        order.append("rested")

    legs.handles(MOVE)(lambda *_: order.append("moved"))
    with legs.running(), planner.running(), eyes.running():
        tidying = user.goal(TIDY, 1)
        tidying.wait_for(tidying.handling.end, timeout=5)
        move = user.command(MOVE, 1, sequential=False)
        go_on.set()
        move.result(timeout=5)
    assert order == ["rested", "moved"]


def test_whoever_waits_too_long_is_told_who_has_it(central: LocalCentral, legs: Module, user: Client) -> None:
    legs.handles(MOVE)(lambda *_: None)
    with legs.running(), connect("other", central) as other:
        with user.lock("legs"):
            with pytest.raises(Timeout, match="was locked by module 'user'"):
                other.lock("legs", timeout=0.05)
            with pytest.raises(Timeout, match="lock of resource 'legs' of 'legs'"):
                other.lock("legs", "legs", timeout=0)
            with pytest.raises(Refused, match="release it"):
                user.reserve("legs")
        with other.reserve("legs", timeout=0):
            pass


def test_a_resource_that_nobody_has(user: Client) -> None:
    with pytest.raises(Refused, match="no module has a resource 'wings'"):
        user.lock("wings")


def test_who_dies_leaves_nothing_locked(central: LocalCentral, legs: Module, user: Client) -> None:
    legs.handles(MOVE)(lambda *_: None)
    with legs.running():
        with connect("other", central) as other:
            other.lock("legs")
            move = user.command(MOVE, 1)
        move.result(timeout=5)


def test_of_two_modules_of_one_name_each_has_a_name_of_its_own(central: LocalCentral, user: Client) -> None:
    first, second = Module("legs", central), Module("legs", central)
    for one in (first, second):
        one.handles(MOVE)(lambda _, __: None)
    with first.running(), second.running():
        for name in ("legs", "legs#2"):
            with user.lock("legs", module=name, timeout=5.0):
                pass
    assert [fact.module for fact in central.facts if isinstance(fact, facts.Claimed)] == ["legs", "legs#2"]


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
