"""``tca run`` with programs that crash, hang or end slowly. ``tca run`` itself may be killed."""

import re
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from module.real_central import until
from supervise.robot_files import HASTY, NO_CENTRAL, SOON, guards_of, kill, robot

from tca_module import Command, Outcome, Query, TaskFailed, connect
from tca_tools.supervise import guard

pytestmark = pytest.mark.slow

STAYS = "[modules.stays]\ncommand = 'sleep 100'\n"


def sh(name: str, program: str, more: str = "") -> str:
    return f"[modules.{name}]\ncommand = ['sh', '-c', '''{program}''']\n{more}\n"


def test_crashed_program_is_restarted_until_its_limit(tmp_path: Path) -> None:
    bad = sh("bad", "echo hello; echo oh no >&2; kill -SEGV $$", "restarts = 2")
    with robot(tmp_path, HASTY + NO_CENTRAL + STAYS + bad) as running:
        code, errors = running.end()
        running.leaves_nothing()
    assert code == 1
    assert "bad" in errors
    assert "SIGSEGV, 3 times within 60 s" in errors
    assert running.said.count("bad started") == 3
    assert "starts again in 0.05 s" in running.said
    assert "starts again in 0.1 s" in running.said
    assert running.said.endswith("bad   | its last lines:\nbad   | hello\nbad   | oh no\n")


def test_program_that_ends_well_stays_ended_unless_configured(tmp_path: Path) -> None:
    text = (
        HASTY
        + NO_CENTRAL
        + sh("once", "echo $TCA_CENTRAL")
        + sh("fails", "exit 3", "restart = 'never'")
    )
    with robot(tmp_path, text) as running:
        assert running.end() == (1, "")
    assert [running.said.count(f"{name} started") for name in ("once", "fails")] == [1, 1]
    assert "once  | ipc:///nowhere\n" in running.said
    with robot(tmp_path, text, "--only", "once") as running:
        assert running.end() == (0, "")
    with robot(
        tmp_path, HASTY + NO_CENTRAL + sh("again", "true", "restart = 'always'\nrestarts = 1")
    ) as running:
        assert running.end()[0] == 1
    assert running.said.count("again started") == 2


CLEANS_UP = """
import signal, sys, time
def end(*_):
    time.sleep(0.3)
    sys.exit(print("cleaned up"))
signal.signal(signal.SIGINT, end)
print("ready")
time.sleep(100)
"""


def test_stop_lets_programs_clean_up_and_kills_the_rest(tmp_path: Path) -> None:
    (tmp_path / "cleans.py").write_text(CLEANS_UP)
    stuck = sh("stuck", "trap '' INT TERM; sleep 100 & sleep 100", "grace = 0.2")
    stopped = sh(
        "stopped", "trap 'exit 0' INT; echo ready; while true; do sleep 0.1; done", "grace = 20"
    )
    text = NO_CENTRAL + sh("slow", "python cleans.py; true", "grace = 20") + stuck + stopped
    with robot(tmp_path, text) as running:
        for _ in ("slow", "stopped"):
            running.hear("ready")
        kill(running.groups["stopped"], signal.SIGSTOP)
        running.signal(signal.SIGTERM)
        assert running.end() == (0, "")
        running.leaves_nothing()
    assert "slow    | cleaned up\n" in running.said
    assert "stuck was ended by SIGKILL" in running.said
    assert "stopped ended with exit code 0" in running.said


@contextmanager
def repeated(act: Callable[[], None]) -> Iterator[None]:
    """Repeat an action five times a second during the block, because the first one may come too
    early.
    """
    over = threading.Event()

    def repeat() -> None:
        while not over.wait(0.2):
            act()

    thread = threading.Thread(target=repeat)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def test_second_signal_kills_programs(tmp_path: Path) -> None:
    with robot(
        tmp_path, NO_CENTRAL + sh("stuck", "trap '' INT TERM; echo ready; sleep 100", "grace = 100")
    ) as running:
        running.hear("ready")
        running.signal(signal.SIGINT)
        running.hear("ends all: SIGINT")
        with repeated(lambda: running.signal(signal.SIGINT)):
            running.hear("is killed")
        assert running.end()[0] == 0
        running.leaves_nothing()


def test_no_program_is_left_when_run_and_guard_are_killed(tmp_path: Path) -> None:
    with robot(
        tmp_path, NO_CENTRAL + STAYS + sh("forks", "sleep 100 & echo ready; wait")
    ) as running:
        running.hear("ready")
        (guarding,) = guards_of(running.process.pid)
        kill(guarding)
        running.hear("another one starts")
        until(lambda: guards_of(running.process.pid), "there is another guard")
        running.signal(signal.SIGKILL)
        running.end()
        assert set(running.groups) == {"stays", "forks"}
        running.leaves_nothing()


def test_program_that_cannot_start_counts_as_crashed(tmp_path: Path) -> None:
    """The guard does not treat the failed start as a process to kill."""
    (tmp_path / "gone.sh").write_text("#!/bin/sh\nrm $0; exit 1\n")
    (tmp_path / "gone.sh").chmod(0o755)
    with robot(
        tmp_path, HASTY + NO_CENTRAL + "[modules.gone]\ncommand = './gone.sh'\nrestarts = 1\n"
    ) as running:
        code, errors = running.end()
    assert (code, "was killed" in errors) == (1, False)
    assert running.said.count("gone can't be started") == 1
    assert running.said.endswith("gone | ./gone.sh: No such file or directory\n")


def test_run_ends_when_its_output_is_closed(tmp_path: Path) -> None:
    text = NO_CENTRAL + sh("talks", "while true; do echo tick; sleep 0.05; done")
    (tmp_path / "robot.toml").write_text(text)
    command = f"{sys.executable} -m tca_tools.supervise {tmp_path}/robot.toml | head -3; echo ${{PIPESTATUS[0]}}"
    output = subprocess.run(
        ["bash", "-c", command], capture_output=True, text=True, timeout=SOON, check=True
    ).stdout
    assert output.splitlines()[-1] == "141"


LEGS = """
import ctypes, os
from tca_module import Command, Module, Query, Task
legs = Module("legs")
legs.handles(Query("who", reply=int))(lambda _: os.getpid())
legs.handles(Command("die"))(lambda _: ctypes.string_at(0))
legs.run()
"""
WHO, DIE = Query("who", reply=int), Command("die")


def test_killed_central_and_modules_are_restarted(tmp_path: Path) -> None:
    address = f"ipc://{tmp_path}/central.sock"
    (tmp_path / "legs.py").write_text(LEGS)
    text = f"""{HASTY}
[central]
address = "{address}"
journal = "journal"
options = ["--lost-after", "2"]
[modules.legs]
command = "python legs.py"
hung = "restart"
"""
    with robot(tmp_path, text) as running, connect("user", address, patience=SOON) as user:
        user.wait_until_handled(WHO, timeout=SOON)
        legs = user.query(WHO)
        dying = user.command(DIE)
        assert dying.wait(timeout=SOON) is Outcome.FAILED
        with pytest.raises(TaskFailed, match="module lost"):
            dying.result()
        running.hear(r"legs was ended by SIGSEGV .*starts again")
        user.wait_until_handled(WHO, timeout=SOON)
        second = user.query(WHO)
        assert legs != second

        running.hear("legs started")
        kill(running.groups["central"])
        running.hear("central was ended by SIGKILL")
        running.hear("central started")
        user.wait_until_handled(WHO, timeout=SOON)
        assert user.query(WHO) == second == running.groups["legs"]

        until(
            lambda: "tca run" in {module.name for module in user.modules()},
            "it hears of lost modules",
        )
        kill(second, signal.SIGSTOP)
        running.hear("legs hung and was killed")
        running.hear("legs started")
        user.wait_until_handled(WHO, timeout=SOON)
        assert user.query(WHO) == running.groups["legs"]
        running.signal(signal.SIGINT)
        code, _ = running.end()
        running.leaves_nothing()
    assert code == 0
    order = re.findall(r"run +\| (\w+) ended with exit code 0", running.said)
    assert order == ["legs", "central"]
    assert not guard.is_alive(second)


def test_robot_file_of_the_example_runs(tmp_path: Path) -> None:
    """A round is finished, although the program that drives crashes during the round."""
    example = Path(__file__).parents[2] / "examples" / "robot"
    for program in example.iterdir():
        if program.is_file():
            (tmp_path / program.name).write_text(program.read_text())
    text = (example / "robot.toml").read_text()
    with robot(
        tmp_path, f"{text}\n[central]\naddress = 'ipc://{tmp_path}/central.sock'\n"
    ) as running:
        running.hear(r"patrol +\| the round is done")
        running.signal(signal.SIGTERM)
        assert running.end()[0] == 0
        running.leaves_nothing()
    assert re.findall(r"to the (\w+)", running.said) == ["kitchen", "hall", "door", "charger"]
    assert "SIGABRT" in running.said
