"""Handlers as modules declare them."""

from collections.abc import Callable
from functools import partial

import pytest
from module.gait_messages import REST, STANCE, TEMPERATURE

from tca_module import Client, MisuseError, Module, Task


def nothing() -> list[int]:
    return []


def only_data(radius: float) -> list[int]:
    return []


def three(task: Task, radius: float, more: int) -> list[int]:
    return []


@pytest.mark.parametrize("function", [only_data, three, nothing])
def test_a_handlers_signature_is_checked_when_it_is_declared(legs: Module, function: Callable[..., list[int]]) -> None:
    with pytest.raises(MisuseError, match=r"is declared with .*: declare it with \(task, data: float\)"):
        legs.handles(STANCE)(function)


def test_one_handler_a_message(legs: Module) -> None:
    legs.handles(STANCE)(lambda _, _radius: [])
    with pytest.raises(MisuseError, match="module 'legs' handles 'stance' already, in test_one_handler_a_message"):
        legs.handles(STANCE)(lambda _, _radius: [])


def test_the_decorator_leaves_the_function_as_it_is(legs: Module) -> None:
    def stance(task: Task, radius: float) -> list[int]:
        return [1]

    assert legs.handles(STANCE)(stance) is stance
    assert legs.handles(REST)(print) is print
    assert repr(legs) == "Module('legs')"


def test_methods_and_partial_functions_handle(legs: Module, user: Client) -> None:
    class Body:
        def stance(self, task: Task, radius: float) -> list[int]:
            return [int(radius)]

    legs.handles(STANCE)(Body().stance)
    legs.handles(TEMPERATURE)(partial(lambda degrees, _: degrees, 36.6))
    with legs.running():
        assert user.query(STANCE, 7.0) == [7]
        assert user.query(TEMPERATURE) == 36.6


def test_handlers_are_declared_before_the_module_runs(legs: Module) -> None:
    with legs.running():
        with pytest.raises(MisuseError, match=r"handles\(\) of module 'legs' comes too late: declare before run"):
            legs.handles(STANCE)
        with pytest.raises(MisuseError, match=r"resource\(\) of module 'legs' comes too late"):
            legs.resource("arm")
        with pytest.raises(MisuseError, match="module 'legs' runs already"), legs.running():
            pass
    legs.handles(STANCE)(lambda _, _radius: [])
