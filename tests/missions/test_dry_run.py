"""``--check``: a mission whose calls are checked, and nothing is sent."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from missions.rover import Rover, rover

from tca_behaviours.missions import (
    BadParameter,
    ConditionVerified,
    Mission,
    MissionTaskFailed,
    Status,
    VariableCondition,
)
from tca_behaviours.missions.charts import FromData, Sequence, StateMachine
from tca_module import Variable, connect
from tca_module.testing import LocalCentral
from tca_wire.journal import facts

LEVEL = Variable("level", float)


@pytest.fixture(autouse=True)
def checking(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["trip.py", "--check"])


@contextmanager
def checked_mission(**options: object) -> Iterator[tuple[LocalCentral, Mission, Rover]]:
    """Open a mission in a dry run. Afterwards no task has been sent."""
    with rover() as (central, robot):
        with Mission("rover", central=central, **options) as mission:  # type: ignore[arg-type]
            yield central, mission, robot
        assert robot.done == []
        received = [fact for fact in central.facts if isinstance(fact, facts.Received)]
        assert not [fact for fact in received if fact.message.startswith(("rover.", "mission "))]


def test_dry_run_completes_each_task_at_once(capsys: pytest.CaptureFixture[str]) -> None:
    with checked_mission() as (_, mission, _):
        assert Status.of(mission.Drive(x=2.0, fails="rock").status) is Status.COMPLETED
        watch, drive = mission.Watch(), mission.start("Drive", fails="never")
        assert mission.wait_for_any_task([watch, drive]) is watch
        mission.update_task(drive, x=3.0)
        mission.stop_task(drive)
        mission.idle()
        assert drive.is_over
    assert capsys.readouterr().out == "mission 'trip': checked 3 calls of tasks\n"


def test_dry_run_reports_a_wrong_parameter(capsys: pytest.CaptureFixture[str]) -> None:
    with checked_mission() as (_, mission, _):
        with pytest.raises(BadParameter, match="parameter 'x' must be at most 10"):
            mission.Drive(x=11)
        drive = mission.start("Drive")
        with pytest.raises(BadParameter, match="has no parameter 'y'"):
            mission.update_task(drive, y=1)


def drive_for_ever(mission: Mission) -> None:
    while True:
        mission.Drive(x=1.0)


def test_dry_run_ends_an_endless_loop(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended, checked_mission() as (_, mission, _):
        drive_for_ever(mission)
    assert not ended.value.code
    assert "1,000 calls" in capsys.readouterr().out


def test_dry_run_checks_the_states_of_a_machine() -> None:
    with Sequence("patrol") as sm:
        sm.Weigh(grams=[1]).keep_end("weight")
        sm.call(lambda data: setattr(data, "x", data.x if data.weight.text else 0))
        sm.Drive(x=FromData("x"))
    with checked_mission() as (_, mission, _):
        data: dict[str, object] = {"x": 1}
        assert sm.run(mission, data=data).outcome == "completed"
        assert "weight" in data
        with pytest.raises(BadParameter):
            sm.run(mission, data={"x": 11})


def test_dry_run_ends_a_machine_as_it_leads() -> None:
    with StateMachine("own", outcomes=["found"]) as own:
        own.Drive().on(completed="found")
    with StateMachine("late") as late:
        late.Drive().on(completed="timeout")
    with StateMachine("endless") as endless:
        endless.call(lambda _: None, "loop").on(completed="loop")
    with checked_mission() as (_, mission, _):
        assert own.run(mission).outcome == "found"
        with pytest.raises(MissionTaskFailed) as caught:
            late.run(mission)
        assert caught.value.status == Status.TIMEOUT | Status.TERMINATED
        with pytest.raises(SystemExit):
            endless.run(mission)


def test_dry_run_verifies_conditions_after_some_calls() -> None:
    with checked_mission() as (_, mission, _):
        condition = VariableCondition(LEVEL, lambda level: level < 0.2)
        mission.add_condition(condition)
        mission.Drive(x=1.0)
        with pytest.raises(ConditionVerified) as caught:
            drive_for_ever(mission)
        assert caught.value.conditions == [condition]
        mission.Drive(x=1.0)


def test_dry_run_does_steps_and_writes_no_file(tmp_path: Path) -> None:
    file = tmp_path / "trip.steps"
    with checked_mission(checkpoint=file) as (_, mission, _):
        assert mission.step("out", mission.Drive, x=1.0).text == "checked, and not run"
        assert mission.repeatable_step("count", lambda: 3) == 3
        mission.skip_step("back")
    assert not file.exists()


def test_dry_run_stops_no_task_of_another_program() -> None:
    with rover() as (central, _), connect("user", central) as user:
        drive = user.command(user.declared("rover.Drive"), {"fails": "never"})
        with Mission("rover", central=central) as mission:
            mission.stop_task(drive.id)
            mission.idle()
        assert [task.id for task in user.tasks()] == [drive.id]
        drive.kill()
