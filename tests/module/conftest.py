"""A central in the test's own process, and a client of it."""

from collections.abc import Iterator

import pytest
from module.robot import Robot

from dev.invariants import check_invariants
from tca_module import Client, Module, connect, module
from tca_module.link import connection, keepalive
from tca_module.session import session
from tca_module.testing import LocalCentral


@pytest.fixture
def central(request: pytest.FixtureRequest) -> Iterator[LocalCentral]:
    """Run a central. It has a stepped clock for test files that set STEPPED."""
    with LocalCentral(
        check=check_invariants, stepped=getattr(request.module, "STEPPED", False)
    ) as central:
        yield central


@pytest.fixture
def user(central: LocalCentral) -> Iterator[Client]:
    """Connect a client outside of all handlers."""
    with connect("user", central) as client:
        yield client


@pytest.fixture
def short_timeouts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let modules notice their end, or a silent central, within 0.2 s instead of 3 s."""
    monkeypatch.setattr(session, "QUIET", 0.2)
    monkeypatch.setattr(session, "IDLE", 0.2)
    monkeypatch.setattr(session, "REPEAT", 0.1)
    monkeypatch.setattr(keepalive, "CHECK_PERIOD", 0.05)
    monkeypatch.setattr(module, "CHECK_PERIOD", 0.05)
    monkeypatch.setattr(connection, "STEP", 0.02)


@pytest.fixture
def robot(central: LocalCentral) -> Robot:
    """Return a planner and legs that do not run yet."""
    return Robot(central)


@pytest.fixture
def legs(central: LocalCentral) -> Module:
    return Module("legs", central)


@pytest.fixture
def eyes(central: LocalCentral) -> Module:
    return Module("eyes", central)
