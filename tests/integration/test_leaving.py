"""A leaving program waits until its messages have arrived. It reports unconfirmed messages with an
exit code.
"""

import re
import signal
import subprocess
import time
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from processes import Central, Process, central, program

from tca_module import Goal, Outcome, connect
from tca_tools.live.questions import status
from tca_wire.journal import facts

pytestmark = pytest.mark.slow

SCRIPT = """
    from tca_module import Inform, connect
    POSE = Inform("pose", bytes)
    with connect("script", linger={linger}) as user:
        user.inform(POSE, b"")
        print("there", flush=True)
        input()
        for _ in range(50):
            user.inform(POSE, bytes(100_000))
        print("leaves", flush=True)
"""
WITHOUT_BLOCK = """
    from tca_module import Inform, connect
    POSE = Inform("pose")
    user = connect("script", linger=0.5)
    user.inform(POSE)
    print("there", flush=True)
    input()
    user.inform(POSE)
"""
IN_THREAD = """
    import threading
    from tca_module import Inform, connect
    POSE = Inform("pose", bytes)
    def work():
        user = connect("script", linger={linger})
        user.inform(POSE, b"")
        print("there", flush=True)
        input()
        for _ in range(50):
            user.inform(POSE, bytes(100_000))
    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
"""
IN_DAEMON_THREAD = """
    import threading
    from tca_module import Command, Inform, connect
    POSE, NOBODY = Inform("pose", bytes), Command("nobody")
    sent = threading.Event()
    def work():
        user = connect("script", linger={linger})
        nobody = user.command(NOBODY)
        user.inform(POSE, b"")
        print("there", flush=True)
        input()
        for _ in range(50):
            user.inform(POSE, bytes(100_000))
        sent.set()
        {goes_on}
    threading.Thread(target=work, name="worker", daemon=True).start()
    sent.wait()
"""
IDLE = IN_DAEMON_THREAD.replace("{goes_on}", "threading.Event().wait()")
WAITING = IN_DAEMON_THREAD.replace("{goes_on}", "nobody.wait()")
SENDING = IN_DAEMON_THREAD.replace("{goes_on}", "while True: user.inform(POSE, b'')")
IN_CHILD = """
    import multiprocessing, sys
    from tca_module import Inform, connect
    POSE = Inform("pose", bytes)
    def work(go_on):
        user = connect("script", linger={linger})
        user.inform(POSE, b"")
        print("there", flush=True)
        go_on.wait()
        for _ in range(50):
            user.inform(POSE, bytes(100_000))
    processes = multiprocessing.get_context("fork")
    go_on = processes.Event()
    child = processes.Process(target=work, args=[go_on])
    child.start()
    input()
    go_on.set()
    child.join()
    sys.exit(child.exitcode)
"""
MODULE = """
    from tca_module import Inform, Module
    POSE = Inform("pose")
    legs = Module("legs")
    with legs.running(linger=0.5):
        legs.inform(POSE)
        print("there", flush=True)
        input()
        legs.inform(POSE)
"""


def stop_central_when_ready(running: Process, daemon: Central) -> None:
    """Stop central, then let the program continue."""
    running.hear("there")
    daemon.signal(signal.SIGSTOP)
    running.stdin.write("go on\n")
    running.stdin.flush()


def soak_only(*values: str) -> Any:
    """Return a case for the soak only, because another test covers the program of this case."""
    return pytest.param(*values, marks=pytest.mark.soak)


@pytest.mark.parametrize("text", [SCRIPT, IN_THREAD, *map(soak_only, (IDLE, WAITING)), IN_CHILD])
def test_leaving_program_waits_for_a_slow_central(text: str, tmp_path: Path) -> None:
    with central(tmp_path) as daemon, program(text.format(linger=60), daemon.address) as script:
        stop_central_when_ready(script, daemon)
        with pytest.raises(subprocess.TimeoutExpired):
            script.wait(2.5)
        daemon.signal(signal.SIGCONT)
        _, message = script.communicate(timeout=30)
        assert (script.returncode, message) == (0, "")
        daemon.stop()
    assert sum(fact.message == "pose" for fact in daemon.facts(facts.Received)) == 51


def test_endlessly_sending_daemon_thread_is_cut_off_silently(tmp_path: Path) -> None:
    with central(tmp_path) as daemon, program(SENDING.format(linger=60), daemon.address) as script:
        _, message = script.communicate("go on\n", timeout=30)
    assert (script.returncode, message) == (0, "")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (SCRIPT.format(linger=0.5), "51 messages of 'script' may not have reached central at "),
        (WITHOUT_BLOCK, "2 messages of 'script' may not have reached central at "),
        soak_only(
            IN_THREAD.format(linger=0.5),
            "51 messages of 'script' may not have reached central at ",
        ),
        (IDLE.format(linger=0.5), "51 messages of 'script' may not have reached central at "),
        (WAITING.format(linger=0.5), "51 messages of 'script' may not have reached central at "),
        soak_only(
            IN_CHILD.format(linger=0.5),
            "51 messages of 'script' may not have reached central at ",
        ),
        (MODULE, "2 messages of 'legs' may not have reached central at "),
    ],
)
def test_leaving_program_reports_unconfirmed_messages(
    text: str, message: str, tmp_path: Path
) -> None:
    with central(tmp_path) as daemon, program(text, daemon.address) as running:
        stop_central_when_ready(running, daemon)
        _, errors = running.communicate(timeout=30)
    assert running.returncode == 1
    assert message in errors.splitlines()[-1]


# --- the first Ctrl-C or SIGTERM ends a program of modules, whatever its handlers wait for ----------


ROBOT = """
import threading, time
from tca_module import Command, Goal, Module, Task

WORK, DOCK, NEVER = Goal("work"), Command("dock"), Command("nobody handles that")
robot = Module("robot")

@robot.handles(WORK)
def work(task: Task) -> None:
    task.command(DOCK)
    task.command(NEVER, sequential=False).wait()

@robot.handles(DOCK, resource="wheels")
def dock(task: Task) -> None:
    print("docking", flush=True)
    while not task.cancelled:
        time.sleep(0.01)
    print("left the dock", flush=True)
"""

RUN = (
    "robot.after(0, lambda callback: callback.goal(WORK))\nrobot.run()\nprint('over', flush=True)\n"
)
RUNNING = "with robot.running():\n    robot.goal(WORK).wait()\n"


@pytest.mark.parametrize(
    ("body", "code", "message"),
    [(RUN, 0, "over\n"), (RUNNING, -signal.SIGINT, "")],
    ids=["run", "running"],
)
def test_first_ctrl_c_ends_the_module_program(
    tmp_path: Path, body: str, code: int, message: str
) -> None:
    with central(tmp_path) as daemon, program(ROBOT + body, daemon.address) as robot:
        robot.hear("docking")
        robot.send_signal(signal.SIGINT)
        output, errors = robot.communicate(timeout=20)
    assert output == f"left the dock\n{message}"
    assert robot.returncode == code
    assert errors.strip().endswith("KeyboardInterrupt" if code else "")


KILLED = """
from tca_module import Goal, Command, Module, Task, TaskKilled

WORK, NEVER = Goal("work"), Command("nobody handles that")
robot = Module("robot")

@robot.handles(WORK)
def work(task: Task) -> None:
    try:
        print("at work", flush=True)
        task.wait_until_handled(NEVER)
    except TaskKilled as error:
        print(error, flush=True)
        task.wait_until_handled(NEVER)

robot.run()
"""


def test_killed_handler_that_keeps_waiting_does_not_block_exit(
    tmp_path: Path,
) -> None:
    with (
        central(tmp_path) as daemon,
        program(KILLED, daemon.address) as robot,
        connect("user", daemon.address) as user,
    ):
        work = Goal("work")
        working = user.goal(work)
        robot.hear("at work")
        working.kill("enough")
        killed = f"{working} was killed: enough (by user); the wait for handlers is given up\n"
        assert robot.stdout.readline() == killed
        waits = r"work \{1\} +until its handler in robot returns, which waits for .* that .*\(killed: enough \(by user\)\)"
        deadline = time.monotonic() + 10
        while not re.search(
            waits, shown := CliRunner().invoke(status, ["--central", daemon.address]).output
        ):
            assert time.monotonic() < deadline, shown
        robot.send_signal(signal.SIGTERM)
        output, errors = robot.communicate(timeout=20)
        assert working.wait(10) is Outcome.KILLED
    assert (output, errors, robot.returncode) == ("", "", 0)
