"""A central in the test's own process, and a client of it."""

from collections.abc import Iterator

import pytest
from module.robot import Robot

from tca_module import Client, Module, connect
from tca_module.testing import LocalCentral


@pytest.fixture
def central() -> Iterator[LocalCentral]:
    with LocalCentral(check=True) as central:
        yield central


@pytest.fixture
def user(central: LocalCentral) -> Iterator[Client]:
    """Whoever sends from outside of handlers."""
    with connect("user", central) as client:
        yield client


@pytest.fixture
def robot(central: LocalCentral) -> Robot:
    """A planner and legs that do not run yet."""
    return Robot(central)


@pytest.fixture
def legs(central: LocalCentral) -> Module:
    return Module("legs", central)


@pytest.fixture
def eyes(central: LocalCentral) -> Module:
    return Module("eyes", central)
