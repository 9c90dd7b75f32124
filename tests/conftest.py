"""Shared fixtures."""

import gc
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Callable, Generator
from pathlib import Path

import pytest
from _pytest.runner import runtestprotocol
from hypothesis import settings

sys.path.insert(0, str(Path(__file__).parent))
import processes
import sampling


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--rewrite", action="store_true", help="rewrite the expected transcripts")
    parser.addoption(
        "--new-lives",
        action="store_true",
        help="new random examples, and more of them",
    )


def pytest_configure(config: pytest.Config) -> None:
    """Make failures repeatable and test processes cheap.

    Random examples have no deadline. They are the same in every run, unless ``--new-lives`` asks
    for new ones.

    Byte code is written even if the environment disables that. Otherwise each of hundreds of test
    processes would compile all sources again.

    Ctrl-C ends the tests and their processes, even if a background shell ignores SIGINT.
    """
    signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.dont_write_bytecode = False
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    new = sampling.in_the_soak = bool(config.getoption("--new-lives"))
    settings.register_profile(
        "ours", derandomize=not new, deadline=None, max_examples=100 if new else 15
    )
    settings.load_profile("ours")
    if not hasattr(config, "workerinput") and config.getoption("numprocesses", None):
        compile_once(config)


def compile_once(config: pytest.Config) -> None:
    """In a fresh clone, compile byte code in one process before the workers start."""
    if not Path(__file__).with_name("central").joinpath("__pycache__").exists():
        command = [sys.executable, "-m", "pytest", "-n", "0", "--collect-only", "-qq", *config.args]
        subprocess.run(
            command, cwd=config.invocation_params.dir, stdout=subprocess.DEVNULL, check=False
        )


@pytest.hookimpl(optionalhook=True)  # xdist may be missing
def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> object:
    """With ``--dist loadfile``, run all tests of the page in one worker, because a browser costs as
    much as ten tests.

    The long simulated lives are half of the soak, and in one file. They are spread over all
    workers, and so are the lives with takeovers.
    """
    if config.getoption("dist") != "loadfile":
        return None
    from xdist.scheduler import LoadFileScheduling  # type: ignore[import-untyped]

    class OneBrowser(LoadFileScheduling):  # type: ignore[misc]
        def _split_scope(self, nodeid: str) -> str:
            if "_lose_and_repeat_no_task_in_many_lives[" in nodeid:
                return nodeid
            return (
                "tests/view" if nodeid.startswith("tests/view/") else super()._split_scope(nodeid)
            )

    return OneBrowser(config, log)


def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
    """In a worker, send one short report of a passed test instead of five long packets.

    The packets cost as much as a small test. ``--durations`` and ``--junit-xml`` get all of them.
    """
    options = item.config.option
    if not hasattr(item.config, "workerinput") or options.durations is not None or options.xmlpath:
        return None
    for report in runtestprotocol(item, log=False, nextitem=nextitem):
        if report.passed:
            report.keywords = {}
        if report.when == "call" or not report.passed:
            item.ihook.pytest_runtest_logreport(report=report)
    return True


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Run no garbage collection while tests are collected. Later ones are rarer than usual, and
    skip the objects that exist by then.
    """
    gc.disable()
    found = yield
    gc.freeze()
    gc.enable()
    gc.set_threshold(50_000, 20, 20)
    return found


def pytest_unconfigure(config: pytest.Config) -> None:
    """Print the processor time of the tests and their processes."""
    processes.end()
    if not hasattr(config, "workerinput"):
        used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
        print(f"processor: {sum(one.ru_utime + one.ru_stime for one in used):.0f} s")


@pytest.fixture(scope="session", autouse=True)
def _state_home(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Keep test journals out of the user's folder, and the user's keys out of the tests."""
    os.environ["XDG_STATE_HOME"] = str(tmp_path_factory.mktemp("state"))
    os.environ["XDG_CONFIG_HOME"] = str(tmp_path_factory.mktemp("config"))


@pytest.fixture
def rewrite(request: pytest.FixtureRequest) -> bool:
    return bool(request.config.getoption("--rewrite"))


@pytest.fixture
def approve(
    request: pytest.FixtureRequest, rewrite: bool
) -> Callable[[str, Callable[[str], object]], None]:
    """Compare a file beside the test. Each line of the file is a case, with its expected text
    indented below. ``--rewrite`` updates the file.
    """

    def compare(name: str, message_of: Callable[[str], object]) -> None:
        path = request.path.parent / name
        cases = [
            line
            for line in path.read_text().splitlines()
            if line.strip() and not line.startswith(" ")
        ]
        text = "\n".join(f"{case}\n    {message_of(case)}\n" for case in cases)
        if rewrite:
            path.write_text(text)
        assert text == path.read_text()

    return compare
