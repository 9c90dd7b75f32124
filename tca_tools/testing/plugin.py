"""The plugin for pytest. Central and the library are imported by the first test that needs them."""

import shutil
from collections.abc import Callable, Generator, Iterator
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from tca_module.testing import LocalCentral
    from tca_tools.testing.daemon import DaemonOfTest

_MARKER = "tca_real_clock: the clock of tca_central runs by itself"
_LAST_LINES = 30
"""Lines of the transcript that a failed test shows."""

_tellers = pytest.StashKey[list[Callable[[], str]]]()
"""Functions that tell what the centrals of a test have recorded."""
_has_failed = pytest.StashKey[bool]()


def pytest_configure(config: pytest.Config) -> None:
    """Register the marker."""
    config.addinivalue_line("markers", _MARKER)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Add the journals of its centrals to the report of a failed test."""
    report = yield
    if report.failed:
        item.stash[_has_failed] = True
        for tell in item.stash.get(_tellers, []):
            report.sections.append(("journal of central", tell()))
    return report


@pytest.fixture
def tca_central(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator["LocalCentral"]:
    """A central in the process of the test: a ``LocalCentral`` with a stepped clock.

    A test that is marked with ``tca_real_clock`` gets the real clock.
    """
    from tca_module.testing import LocalCentral  # noqa: PLC0415

    stepped = request.node.get_closest_marker("tca_real_clock") is None
    with LocalCentral(stepped=stepped) as central:

        def tell() -> str:
            path = tmp_path_factory.mktemp("tca") / "journal.tcaj"
            central.save(path)
            last = central.transcript().splitlines()[-_LAST_LINES:]
            return "\n".join([f"tca log show {path}", *last])

        request.node.stash.setdefault(_tellers, []).append(tell)
        yield central


@pytest.fixture
def tca_daemon(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator["DaemonOfTest"]:
    """A central that runs as a process, at an address of its own: a ``DaemonOfTest``.

    During the test ``$TCA_CENTRAL`` has its address. The journal and the logs of a test that passes
    are deleted.
    """
    from tca_tools.testing.daemon import daemon_in  # noqa: PLC0415

    folder = tmp_path_factory.mktemp("tca")
    with daemon_in(folder) as daemon:
        logs = f"logs of the programs: {folder}"
        tellers = request.node.stash.setdefault(_tellers, [])
        tellers.append(lambda: f"tca log show {daemon.journal}\n{logs}")
        yield daemon
    if not request.node.stash.get(_has_failed, False):
        shutil.rmtree(folder)
