"""Figure 7 of the paper as runs on a stepped clock: early work that is kept, replaced, wasted, or
never started.
"""

import itertools
import re
from pathlib import Path

import pytest

from robots.youbot_sim.__main__ import main
from robots.youbot_sim.coordination import likelihood, make_coordinator
from robots.youbot_sim.delivery import make_delivery
from robots.youbot_sim.messages import CARRY_OBJECTS, MEASURE, MOVE_ARM
from robots.youbot_sim.outcome import CarriedObject, DoneTask, read_delivery
from robots.youbot_sim.robot import Backend
from robots.youbot_sim.seeds import TABLE_HEAD, compare, row, summary
from robots.youbot_sim.show import SCHEDULES, show
from robots.youbot_sim.simulator import Lid
from robots.youbot_sim.stepped import deliver, robot
from robots.youbot_sim.vocabulary import ObjectPlace
from tca_behaviours.coordination import Continuous, Coordinator, Discrete, Prior
from tca_module import connect
from tca_tools.journal.fold import History
from tca_wire.coordination import TaskRole

RECORD = Path(__file__).parents[2].joinpath("dev/records/preview-coordination.md").read_text()
TO_B = ["taking", "going to B", "arm to box B", "dropping in B", "tucking", "going back", "homing"]
TO_C = [
    "taking",
    "going to B",
    "going to C",
    "arm to box C",
    "dropping in C",
    "tucking",
    "going back",
    "homing",
]


def delivered(name: str) -> CarriedObject:
    """Run one of the schedules. Return what the robot carried out."""
    schedule = SCHEDULES[name]
    lid = schedule.lid
    return read_delivery(deliver(lid, make_coordinator(has_preview=schedule.has_preview)).entries)


def states(tasks: list[DoneTask]) -> list[str]:
    return [task.state for task in tasks]


def the(found: CarriedObject, state: str) -> DoneTask:
    (task,) = [task for task in found.tasks if task.state == state]
    return task


def test_arm_is_at_box_b_before_the_base_in_the_best_case() -> None:
    best = delivered("best")
    assert states(list(best.tasks)) == TO_B
    assert states(best.with_role(TaskRole.KEPT)) == ["arm to box B"]
    assert not best.with_role(TaskRole.WASTED)
    base, arm, drop = the(best, "going to B"), the(best, "arm to box B"), the(best, "dropping in B")
    assert base.start <= arm.start < arm.end < base.end
    assert drop.start == pytest.approx(base.end)


def test_arm_move_is_replaced_when_box_b_is_covered() -> None:
    changed = delivered("changed")
    assert sorted(states(list(changed.tasks))) == sorted([*TO_C, "arm to box B"])
    assert states(changed.with_role(TaskRole.WASTED)) == ["arm to box B"]
    assert states(changed.with_role(TaskRole.KEPT)) == ["arm to box C"]
    wasted, arm = the(changed, "arm to box B"), the(changed, "arm to box C")
    to_b, to_c = the(changed, "going to B"), the(changed, "going to C")
    assert wasted.end <= arm.start < arm.end < to_b.end
    assert wasted.end - wasted.start == pytest.approx(changed.seconds_in_vain)
    assert wasted.roles == (TaskRole.AHEAD, TaskRole.WASTED)
    assert the(changed, "dropping in C").start == pytest.approx(to_c.end)


def test_tasks_run_one_by_one_without_a_preview() -> None:
    plain = delivered("plain")
    assert states(list(plain.tasks)) == TO_C
    assert {task.roles for task in plain.tasks} == {(TaskRole.CURRENT,)}
    assert all(
        before.end <= after.start + 1e-6 for before, after in itertools.pairwise(plain.tasks)
    )


@pytest.mark.soak
def test_each_schedule_saves_the_expected_time() -> None:
    best, changed, plain = (delivered(name).seconds for name in ("best", "changed", "plain"))
    assert best < changed < plain
    free = read_delivery(deliver(Lid(), make_coordinator(has_preview=False)).entries)
    assert free.seconds - best == pytest.approx(
        the(delivered("best"), "arm to box B").end - 1.35, abs=0.1
    )


def test_journal_equals_the_plain_one_when_likelihoods_are_0() -> None:
    unlikely = make_delivery()
    for state in unlikely.states:
        for arrow in state.arrows:
            arrow.model = Prior(0.0)
    plain, looking = (
        deliver(Lid((3.0,)), coordinator).transcript()
        for coordinator in (
            make_coordinator(has_preview=False),
            Coordinator(unlikely, policy=Discrete(0.01, likelihood)),
        )
    )
    assert re.sub(r'"refused": \[[^]]*\]', '"refused": []', looking) == plain, (
        "but for the objections"
    )


def test_early_slow_arm_move_speeds_up_when_its_state_is_entered() -> None:
    """With the continuous policy, the arm speeds up as the base approaches. The arm does not stop
    meanwhile.
    """
    coordinator = Coordinator(make_delivery(), policy=Continuous(from_=0.0, to=2.0))
    central = deliver(Lid(), coordinator)
    first_arm = next(
        task for task in History.until(central.entries).tasks.values() if task.name == MOVE_ARM.name
    )
    asked = [
        MOVE_ARM.decode_data(change.body).speed
        for change in first_arm.life
        if change.transition == "update"
    ]
    assert asked == [0.2, 0.3, 0.4, 0.5, 1.0]
    found = read_delivery(central.entries)
    arm = the(found, "arm to box B")
    assert arm.roles == (TaskRole.AHEAD, TaskRole.KEPT)
    assert arm.end - arm.start > 2.3


def test_two_objects_are_delivered_to_their_boxes() -> None:
    with (
        robot(Lid((9.0,)), make_coordinator()) as central,
        connect("somebody", central) as somebody,
    ):
        central.advance(1.0)
        carrying = somebody.command(CARRY_OBJECTS, 2)
        central.advance(15.0)
        assert somebody.query(MEASURE).object is ObjectPlace.BOX_B
        central.advance(30.0)
        assert carrying.state == "done"


@pytest.mark.soak
def test_table_of_seeds_is_reproducible(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["youbot_sim", "--seeds", "1"])
    assert main() == 0
    table, end = capsys.readouterr().out.split("\n\n")
    assert table in RECORD
    assert end.startswith("Speed-up")
    monkeypatch.setattr("sys.argv", ["youbot_sim", "--seeds", "0"])
    with pytest.raises(SystemExit):
        main()
    assert "the number of seeds is 1 or more, not 0" in capsys.readouterr().err


@pytest.mark.soak
def test_recorded_table_is_current_and_no_preview_costs_time() -> None:
    rows = list(compare(20))
    assert "\n".join([TABLE_HEAD, *map(row, rows), "", summary(rows)]) in RECORD
    assert all(one.speed_up > 1 for one in rows)


@pytest.mark.slow
@pytest.mark.soak
@pytest.mark.parametrize("backend", ["auto", "kinematic"])
def test_separate_programs_reach_the_same_schedule(backend: Backend, tmp_path: Path) -> None:
    found, picture = show(SCHEDULES["changed"], tmp_path, backend)
    assert {task.state: task.roles for task in found.tasks} == {
        task.state: task.roles for task in delivered("changed").tasks
    }
    assert picture.exists()
