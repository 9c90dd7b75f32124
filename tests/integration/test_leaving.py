"""A program that leaves waits until what it sent has arrived; what may not have, it says, with an exit code."""

import signal
import subprocess
from pathlib import Path
from typing import Any

import pytest
from integration.programs import Central, central, program

from tca_tools.journal.journals import open_log
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
IN_A_THREAD = """
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
IN_A_THREAD_THAT_GOES_ON = """
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
IDLE = IN_A_THREAD_THAT_GOES_ON.replace("{goes_on}", "threading.Event().wait()")
WAITING = IN_A_THREAD_THAT_GOES_ON.replace("{goes_on}", "nobody.wait()")
SENDING = IN_A_THREAD_THAT_GOES_ON.replace("{goes_on}", "while True: user.inform(POSE, b'')")
IN_A_CHILD = """
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


def stopped_when_there(running: "subprocess.Popen[str]", daemon: Central) -> None:
    """The program goes on when central stands still."""
    assert running.stdout
    assert running.stdin
    assert running.stdout.readline() == "there\n"
    daemon.signal(signal.SIGSTOP)
    running.stdin.write("go on\n")
    running.stdin.flush()


def soaked(*values: str) -> Any:
    """Each of these programs is also in another test, which is not of the soak."""
    return pytest.param(*values, marks=pytest.mark.soak)


@pytest.mark.parametrize("text", [SCRIPT, IN_A_THREAD, *map(soaked, (IDLE, WAITING)), IN_A_CHILD])
def test_all_arrives_at_a_central_that_takes_its_time(text: str, tmp_path: Path) -> None:
    with central(tmp_path) as daemon, program(text.format(linger=60), daemon.address) as script:
        stopped_when_there(script, daemon)
        with pytest.raises(subprocess.TimeoutExpired):
            script.wait(2.5)
        daemon.signal(signal.SIGCONT)
        _, said = script.communicate(timeout=30)
        assert (script.returncode, said) == (0, "")
        daemon.stop()
        received = [
            fact for entry in open_log(daemon.journal) for fact in entry.facts if isinstance(fact, facts.Received)
        ]
    assert sum(fact.message == "pose" for fact in received) == 51


def test_a_thread_that_never_stops_sending_is_cut_off_without_a_word(tmp_path: Path) -> None:
    with central(tmp_path) as daemon, program(SENDING.format(linger=60), daemon.address) as script:
        _, said = script.communicate("go on\n", timeout=30)
    assert (script.returncode, said) == (0, "")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (SCRIPT.format(linger=0.5), "51 messages of 'script' may not have reached central at "),
        (WITHOUT_BLOCK, "2 messages of 'script' may not have reached central at "),
        soaked(IN_A_THREAD.format(linger=0.5), "51 messages of 'script' may not have reached central at "),
        (IDLE.format(linger=0.5), "51 messages of 'script' may not have reached central at "),
        (WAITING.format(linger=0.5), "51 messages of 'script' may not have reached central at "),
        soaked(IN_A_CHILD.format(linger=0.5), "51 messages of 'script' may not have reached central at "),
        (MODULE, "2 messages of 'legs' may not have reached central at "),
    ],
)
def test_what_may_be_lost_is_said_with_an_exit_code(text: str, said: str, tmp_path: Path) -> None:
    with central(tmp_path) as daemon, program(text, daemon.address) as running:
        stopped_when_there(running, daemon)
        _, errors = running.communicate(timeout=30)
    assert running.returncode == 1
    assert said in errors.splitlines()[-1]
