"""Programs end with the process that started them."""

import os
import re
import signal
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

import pytest
from module.real_central import until
from processes import Process

from tca_tools.supervise import guard
from tca_tools.supervise.programs import ProgramEnded, Programs
from tca_wire.endpoint import VARIABLE

DEAF = ("sh", "-c", "trap '' INT TERM; echo deaf; sleep 60 & sleep 60")
IDLE = ("sh", "-c", "echo idle; exec sleep 60")


@contextmanager
def interrupted_after(seconds: float) -> Iterator[None]:
    """Raise KeyboardInterrupt in the block after *seconds*, as Ctrl-C does."""

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupt)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def start(programs: Programs, name: str, command: tuple[str, ...]) -> int:
    """Start a program, and wait for its first output. Return its process number."""
    process = programs.start(name, *command)
    until(lambda: programs.log(name).read_text(), f"{name} has begun")
    return process


@pytest.mark.filterwarnings(
    "ignore:.*/proc/.*/stat:pytest.PytestUnraisableExceptionWarning"
)  # if interrupted in open()
def test_interrupted_wait_leaves_no_program_behind(tmp_path: Path) -> None:
    programs = Programs(tmp_path).__enter__()
    both = [start(programs, "idle", IDLE), start(programs, "deaf", DEAF)]
    with pytest.raises(KeyboardInterrupt), interrupted_after(0.2):
        programs.__exit__()
    until(lambda: not any(map(guard.is_alive, both)), "they have ended")


def test_halted_program_ends_on_stop(tmp_path: Path) -> None:
    with Programs(tmp_path) as programs:
        start(programs, "idle", IDLE)
        programs.halt("idle")
        assert programs.stop("idle") == [-signal.SIGINT]


def test_program_that_is_stopped_has_not_ended_early(tmp_path: Path) -> None:
    """It is checked all the time, from another thread."""
    with Programs(tmp_path) as programs, ThreadPoolExecutor(1) as pool:

        def stop_three_times() -> None:
            for _ in range(3):
                programs.start("quick", "sleep", "60")
                programs.stop("quick")

        stopped = pool.submit(stop_three_times)
        while not stopped.done():
            programs.check()
        stopped.result()


def test_program_that_ends_early_is_noticed(tmp_path: Path) -> None:
    with Programs(tmp_path) as programs:
        start(programs, "short", ("echo", "hello"))
        time.sleep(0.1)
        with pytest.raises(ProgramEnded, match=f"short has ended: see {tmp_path}/short.log"):
            programs.check()


LONELY = """
import contextlib
from tca_module import CentralLost, Module
with contextlib.suppress(CentralLost):
    Module("legs").run(patience=1.5)
print("ended")
"""


@pytest.mark.parametrize("starts_central", [True, False])
def test_wait_for_central_is_not_logged_while_central_starts(
    tmp_path: Path, starts_central: bool
) -> None:
    address = f"ipc://{tmp_path}/central.sock"
    with Programs(tmp_path, address=address if starts_central else "") as programs:
        programs.start("legs", "env", f"{VARIABLE}={address}", sys.executable, "-uc", LONELY)
        until(lambda: "ended" in programs.log("legs").read_text(), "it gives up")
        assert ("start it with: tca central" in programs.log("legs").read_text()) != starts_central


STARTER = """
import pathlib, sys, time
from tca_tools.supervise.programs import Programs
programs = Programs(pathlib.Path(sys.argv[1]), grace=0.2).__enter__()
print(programs.start("deaf", *sys.argv[2:]), programs.start("central", *sys.argv[2:], ends_last=True), flush=True)
time.sleep(60)
"""


@pytest.mark.slow
def test_no_program_survives_a_killed_starter(tmp_path: Path) -> None:
    with Process("-c", STARTER, str(tmp_path), *DEAF) as starter:
        groups = [int(word) for word in starter.stdout.readline().split()]
        os.kill(starter.pid, signal.SIGKILL)
        assert re.search("killed; its 2 programs are ended", starter.stderr.readline())
        until(lambda: not any(map(guard.is_alive, groups)), "they have ended")
