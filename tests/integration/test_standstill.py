"""A central that stands still for longer than its users wait, and then goes on."""

import signal
from pathlib import Path

import pytest
from integration.programs import central

from tca_module import CentralLost, Command, Outcome, Variable, connect
from tca_tools.run.journals import open_log
from tca_wire.journal import facts

pytestmark = pytest.mark.slow

REST, POSE = Command("rest"), Variable("pose", int)


def test_a_task_whose_sender_believes_it_lost_is_not_done_when_central_goes_on(tmp_path: Path) -> None:
    with central(tmp_path) as daemon, connect("user", daemon.address, patience=1.0) as user:
        user.set_variable(POSE, 1)
        user.command(REST).kill()
        daemon.signal(signal.SIGSTOP)
        with pytest.raises(
            CentralLost, match="command 'rest' is killed as soon as central answers, if it had heard of"
        ):
            user.command(REST)
        with pytest.raises(CentralLost, match="setting variable 'pose' may yet be done, if central had heard of it"):
            user.set_variable(POSE, 2)
        daemon.signal(signal.SIGCONT)
        assert user.get_variable(POSE) == 2
        assert user.tasks() == []
        wanted = user.command(REST)
        assert [task.id for task in user.tasks()] == [wanted.id]
        wanted.kill()
        assert wanted.wait(5) is Outcome.KILLED
        daemon.stop()
        killed = [fact for entry in open_log(daemon.journal) for fact in entry.facts if isinstance(fact, facts.Killed)]
    assert [(fact.by, bool(fact.why)) for fact in killed] == [("user", False), ("user", True), ("user", False)]
