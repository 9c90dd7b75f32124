"""``tca run`` with a replicated log on this computer, from one line."""

import signal
from pathlib import Path

import pytest
from supervise.robot_files import HASTY, SOON, kill, robot

from tca_module import Command, Outcome, connect

pytestmark = pytest.mark.slow

LEGS = """
import os, time
from tca_module import Command, Module, Task
legs = Module("legs")
@legs.handles(Command("walk"))
def walk(_: Task) -> None:
    print("walks")
    while not os.path.exists("arrived"):
        time.sleep(0.05)
legs.run(patience=60)
"""
WALK = Command("walk")


def test_command_continues_when_central_of_a_trial_is_killed(tmp_path: Path) -> None:
    address = f"ipc://{tmp_path}/c.sock,ipc://{tmp_path}/c-2.sock"
    (tmp_path / "legs.py").write_text(LEGS)
    text = f"""{HASTY}
[central]
address = "ipc://{tmp_path}/c.sock"
journal = "journal"
replicated_log = "trial"
[modules.legs]
command = "python legs.py"
"""
    with robot(tmp_path, text) as running, connect("user", address, patience=SOON) as user:
        user.wait_until_handled(WALK, timeout=SOON)
        walking = user.command(WALK)
        running.hear(r"legs +\| walks")
        kill(running.groups["central"])
        running.hear(r"central was ended by SIGKILL")
        running.hear(r"standby +\| central: leads now")
        (tmp_path / "arrived").touch()
        assert walking.wait(timeout=SOON) is Outcome.DONE
        user.close()
        running.signal(signal.SIGINT)
        assert running.end()[0] == 0
        running.leaves_nothing()
    assert (tmp_path / "journal" / "nats" / "1").is_dir()
    assert set(running.groups) == {"nats.1", "nats.2", "nats.3", "central", "standby", "legs"}
    ends = [
        line.split()[2] for line in running.said.splitlines() if "ended with exit code 0" in line
    ]
    assert ends[0] == "legs"
    assert sorted(ends[1:3]) == ["central", "standby"]
    assert sorted(ends[3:]) == ["nats.1", "nats.2", "nats.3"]
