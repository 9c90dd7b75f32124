"""The programs of a robot end with the one who started them."""

import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

import pytest

from robots.ambler_sim.run.losing import ProgramKiller
from robots.processes import Processes
from tca_module import TcaError

DEAF = "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('deaf', flush=True); time.sleep(60)"
IDLE = "import time; print('idle', flush=True); time.sleep(60)"


@contextmanager
def interrupted_after(seconds: float) -> Iterator[None]:
    """As by Ctrl-C."""

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupt)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def start(processes: Processes, name: str, program: str) -> int:
    """Run a program until it has said something; its process."""
    processes.start(name, "timeit", "-n1", "-r1", program)
    deadline = time.monotonic() + 20
    while not processes.log(name).read_text():
        assert time.monotonic() < deadline
        time.sleep(0.01)
    return processes.numbers()[name]


def is_alive(process: int) -> bool:
    """Whether it runs."""
    return Path(f"/proc/{process}").exists()


def test_who_does_not_wait_for_them_leaves_no_program_behind(tmp_path: Path) -> None:
    processes = Processes(tmp_path, {})
    both = [start(processes, "idle", IDLE), start(processes, "deaf", DEAF)]
    with pytest.raises(KeyboardInterrupt), interrupted_after(0.2):
        processes.__exit__()
    assert not any(map(is_alive, both))


def test_a_program_that_was_halted_ends_when_it_is_told_to(tmp_path: Path) -> None:
    with Processes(tmp_path, {}) as processes:
        start(processes, "idle", IDLE)
        processes.halt("idle")
        assert processes.stop("idle") == -signal.SIGTERM


@pytest.mark.soak
def test_a_planner_that_was_halted_is_back_though_central_does_not_answer(tmp_path: Path) -> None:
    with Processes(tmp_path, {}) as processes:
        halted = start(processes, "footfall planner", IDLE)
        processes.halt("footfall planner")
        with pytest.raises(TcaError):
            ProgramKiller(processes, f"ipc://{tmp_path}/nobody.sock")._kill_when_asked("footfall planner")
        assert processes.numbers()["footfall planner"] != halted
        assert not is_alive(halted)
