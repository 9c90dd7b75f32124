"""Central is busy for long with one event, such as the kill of a very large tree: that is nobody else's fault."""

import signal
from pathlib import Path

import pytest
from integration.programs import central, program

from tca_module import CentralLost, Client, Command, Goal, Outcome, Query, SentTask, connect
from tca_tools.journal.journals import open_log
from tca_wire.constraints import Flags
from tca_wire.journal import facts
from tca_wire.packets import headers

pytestmark = pytest.mark.slow

WALK, STEP = Goal("walk"), Command("step")
DIG, DEPTH = Command("dig", result=int), Query("depth", reply=int)

DIGGER = """
    from tca_module import *
    digger, gauge = Module("digger"), Module("gauge")
    @gauge.handles(Query("depth", reply=int))
    def depth(task: Task) -> int:
        return 7
    @digger.handles(Command("dig", result=int))
    def dig(task: Task) -> int:
        print("digging", flush=True)
        while not task.cancelled:
            pass
        return 0
    with gauge.running(), digger.running():
        print("ready", flush=True)
        import signal; signal.pause()
"""

TASKS = 2_000


def test_the_kill_of_a_very_large_tree_costs_no_living_module_its_place(tmp_path: Path) -> None:
    """Central stands still for a while, and here is stopped, too, as on a slower day: who has no patience is told; what
    is handled goes on, and who handles stays.
    """
    with central(tmp_path) as daemon, program(DIGGER, daemon.address) as digger:
        assert digger.stdout is not None
        assert digger.stdout.readline() == "ready\n"
        with (
            connect("user", daemon.address, patience=120) as user,
            connect("hasty", daemon.address, patience=0.3) as hasty,
        ):
            dig, walk = user.command(DIG), user.goal(WALK)
            assert digger.stdout.readline() == "digging\n"
            fill(user, walk)
            assert user.query(DEPTH, timeout=60) == 7
            daemon.signal(signal.SIGSTOP)
            with pytest.raises(CentralLost):
                hasty.query(DEPTH)
            daemon.signal(signal.SIGCONT)
            assert walk.kill()
            assert walk.wait(timeout=60) is Outcome.KILLED
            assert user.query(DEPTH, timeout=60) == 7
            assert {"digger", "gauge", "hasty"} <= {module.name for module in user.modules()}
            assert dig.kill()
            assert dig.wait(timeout=60) is Outcome.KILLED
    recorded = [fact for entry in open_log(daemon.journal) for fact in entry.facts]
    assert sum(isinstance(fact, facts.Killed) for fact in recorded) == TASKS + 2
    assert not [fact for fact in recorded if isinstance(fact, facts.Failed)]


def fill(user: Client, walk: SentTask[None]) -> None:
    """What ``command`` does, but without waiting for each."""
    connection = user._connection()
    connection.declare(STEP)
    for _ in range(TASKS):
        connection.request(headers.Send(0, STEP.name, parent=walk.id, flags=Flags.NONE), STEP.encode_data(None))
