"""A module that is started before central waits, and says for what."""

from pathlib import Path

import pytest
from module.real_central import RealCentral
from processes import program

pytestmark = pytest.mark.slow

MODULE = """
    from tca_module import Module

    with Module("legs").running():
        print("runs", flush=True)
"""


def test_module_says_that_it_waits_for_central(tmp_path: Path) -> None:
    address = f"ipc://{tmp_path}/c.sock"
    with program(MODULE, address) as early:
        assert address in early.stderr.readline()
        with RealCentral(address):
            early.hear("runs")
            assert early.communicate() == ("", "")


def test_module_that_finds_central_says_nothing(tmp_path: Path) -> None:
    with RealCentral(f"ipc://{tmp_path}/c.sock") as daemon:
        assert program(MODULE, daemon.address).communicate() == ("runs\n", "")
