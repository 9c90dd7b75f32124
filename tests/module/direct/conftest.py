"""A real central, and a user of it."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from module.real_central import RealCentral

from tca_module import Client, connect


@pytest.fixture
def central(tmp_path: Path) -> Iterator[RealCentral]:
    with RealCentral(f"ipc://{tmp_path}/central.sock") as central:
        yield central


@pytest.fixture
def user(central: RealCentral) -> Iterator[Client]:
    with connect("user", central.address) as user:
        yield user
