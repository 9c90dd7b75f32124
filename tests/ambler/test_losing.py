"""A lost program is restarted."""

from pathlib import Path

import pytest

from robots.ambler_sim.run.losing import ProgramKiller
from tca_module import TcaError
from tca_tools.supervise import guard
from tca_tools.supervise.programs import Programs


@pytest.mark.soak
def test_halted_planner_restarts_when_central_does_not_answer(tmp_path: Path) -> None:
    with Programs(tmp_path) as programs:
        halted = programs.start("footfall planner", "sleep", "60")
        programs.halt("footfall planner")
        with pytest.raises(TcaError):
            ProgramKiller(programs, f"ipc://{tmp_path}/nobody.sock")._kill_when_asked(
                "footfall planner"
            )
        assert programs.numbers()["footfall planner"] != halted
        assert not guard.is_alive(halted)
