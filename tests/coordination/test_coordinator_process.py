"""A coordinator as a process: its journal, likelihoods learned from this journal, and Ctrl-C during
early work.
"""

import signal
import threading
from pathlib import Path

import pytest
from coordination.delivery_robot import MOVE_ARM, MOVE_BASE, arm, base
from processes import central, program

from tca_behaviours.coordination import Coordination, Coordinator, count_transitions
from tca_module import Module, Outcome, Task, connect

pytestmark = pytest.mark.slow
SOON = 20.0

PROGRAM = """
import sys
sys.path.insert(0, "{tests}")
from coordination.test_coordinator_process import reaching
from tca_behaviours.coordination import Coordinator, Discrete
from tca_module import Module

coordinator = Coordinator(reaching(), policy=Discrete(0.5, utility=lambda candidate: candidate.probability))
module = Module("coordinator")
coordinator.handle_in(module)
module.run()
print("over", flush=True)
"""


def reaching() -> Coordination:
    """Drive to B, then move the arm to its box."""
    with Coordination("reaching", facts={"base": "A", "arm": "home"}) as machine:
        to_b, reach = machine.state("to B", base("B")), machine.state("reach", arm("box B"))
        to_b.to(reach)
        reach.to(machine.final("end"))
    return machine


def test_coordinator_process_previews_stops_and_is_learned_from(tmp_path: Path) -> None:
    robot, moving, is_quick = Module("robot"), threading.Semaphore(0), True

    def move(task: Task, _: str) -> None:
        moving.release()
        task.sleep(0.02 if is_quick else SOON)

    robot.handles(MOVE_BASE, resource="base")(move)
    robot.handles(MOVE_ARM, resource="arm")(move)
    local = Coordinator(reaching())
    text = PROGRAM.format(tests=str(Path(__file__).parents[1]))
    with central(tmp_path) as daemon, program(text, daemon.address) as process:
        robot.central = daemon.address
        with robot.running(), connect("user", daemon.address) as user:
            end = local.run(user)
            assert (end.state, end.kept) == ("end", 1)
            is_quick = False
            run = user.command(local.message, local.chart)
            for _ in range(4):
                assert moving.acquire(timeout=SOON)
            process.send_signal(signal.SIGINT)
            assert run.wait(timeout=SOON) is Outcome.FAILED
            assert user.tasks() == []
            assert process.communicate(timeout=SOON)[0] == "over\n"
        daemon.stop()
    assert count_transitions([daemon.journal], local.chart) == {
        ("to B", "done"): 1,
        ("reach", "done"): 1,
    }
