"""A program that leaves waits until what it sent has arrived; what may not have, it says, with an exit code."""

import signal
import subprocess
from pathlib import Path

import pytest
from integration.programs import Central, central, program

from tca_tools.run.journals import open_log
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


def test_all_arrives_at_a_central_that_takes_its_time(tmp_path: Path) -> None:
    with central(tmp_path) as daemon, program(SCRIPT.format(linger=60), daemon.address) as script:
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
    assert len(received) == 51


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (SCRIPT.format(linger=0.5), "51 messages of 'script' may not have reached central at "),
        (WITHOUT_BLOCK, "2 messages of 'script' may not have reached central at "),
        (MODULE, "2 messages of 'legs' may not have reached central at "),
    ],
)
def test_what_may_be_lost_is_said_with_an_exit_code(text: str, said: str, tmp_path: Path) -> None:
    with central(tmp_path) as daemon, program(text, daemon.address) as running:
        stopped_when_there(running, daemon)
        _, errors = running.communicate(timeout=30)
    assert running.returncode == 1
    assert errors.splitlines()[-1].startswith(said)
