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
from hypothesis import settings

sys.path.insert(0, str(Path(__file__).parent))
import processes
import sampling


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--rewrite", action="store_true", help="write the expected transcripts anew")
    parser.addoption(
        "--new-lives",
        action="store_true",
        help="random examples that were never tried before, and more",
    )


def pytest_configure(config: pytest.Config) -> None:
    """What fails is due to what was changed: random examples are the same in every run, unless new
    ones are wanted, and may take their time on a busy machine.

    Byte code is kept, also where the environment (of many containers) says otherwise: else each of
    the hundreds of processes that the tests start compiles all sources anew.

    Ctrl-C ends what the tests start, also where a shell in the background has told everything to
    ignore it.
    """
    signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.dont_write_bytecode = False
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    new = sampling.in_the_soak = bool(config.getoption("--new-lives"))
    settings.register_profile(
        "ours", derandomize=not new, deadline=None, max_examples=100 if new else 40
    )
    settings.load_profile("ours")
    if not hasattr(config, "workerinput") and config.getoption("numprocesses", None):
        compile_once(config)


def compile_once(config: pytest.Config) -> None:
    """In a fresh clone one process makes the byte code, before each worker makes all of it."""
    if not Path(__file__).with_name("central").joinpath("__pycache__").exists():
        command = [sys.executable, "-m", "pytest", "-n", "0", "--collect-only", "-qq", *config.args]
        subprocess.run(
            command, cwd=config.invocation_params.dir, stdout=subprocess.DEVNULL, check=False
        )


@pytest.hookimpl(optionalhook=True)  # not all have xdist
def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> object:
    """With ``--dist loadfile`` one worker runs all tests of the page: a browser costs as much as
    ten of them. The long simulated lives, half of the soak in one file, are shared out.
    """
    if config.getoption("dist") != "loadfile":
        return None
    from xdist.scheduler import LoadFileScheduling  # type: ignore[import-untyped]

    class OneBrowser(LoadFileScheduling):  # type: ignore[misc]
        def _split_scope(self, nodeid: str) -> str:
            if "::test_simulated_crashes_lose_and_repeat_no_task_in_many_lives[" in nodeid:
                return nodeid
            return (
                "tests/view" if nodeid.startswith("tests/view/") else super()._split_scope(nodeid)
            )

    return OneBrowser(config, log)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """No collection of garbage looks through thousands of tests and all modules: not while they
    come, and not later. Later ones are rarer than usual: most of what tests make goes without them.
    """
    gc.disable()
    found = yield
    gc.freeze()
    gc.enable()
    gc.set_threshold(50_000, 20, 20)
    return found


def pytest_unconfigure(config: pytest.Config) -> None:
    """All that the tests and the processes they started have cost."""
    processes.end()
    if not hasattr(config, "workerinput"):
        used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
        print(f"processor: {sum(one.ru_utime + one.ru_stime for one in used):.0f} s")


@pytest.fixture(scope="session", autouse=True)
def _state_home(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Centrals of the tests leave nothing in the user's own folder of journals, and show none of
    the user's keys.
    """
    os.environ["XDG_STATE_HOME"] = str(tmp_path_factory.mktemp("state"))
    os.environ["XDG_CONFIG_HOME"] = str(tmp_path_factory.mktemp("config"))


@pytest.fixture
def rewrite(request: pytest.FixtureRequest) -> bool:
    return bool(request.config.getoption("--rewrite"))


@pytest.fixture
def approve(
    request: pytest.FixtureRequest, rewrite: bool
) -> Callable[[str, Callable[[str], object]], None]:
    """Each line of a file beside the test is a case, and the indented one below is told of it:
    ``--rewrite`` writes it.
    """

    def compare(name: str, tell: Callable[[str], object]) -> None:
        path = request.path.parent / name
        cases = [
            line
            for line in path.read_text().splitlines()
            if line.strip() and not line.startswith(" ")
        ]
        told = "\n".join(f"{case}\n    {tell(case)}\n" for case in cases)
        if rewrite:
            path.write_text(told)
        assert told == path.read_text()

    return compare
