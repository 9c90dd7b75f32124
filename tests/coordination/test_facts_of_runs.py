"""Facts in runs. Early work is undone where its facts matter, so the machine takes the same path as
without early work.
"""

import pytest
from coordination.delivery_robot import (
    ARM,
    AS_SOON_AS_LIKELY,
    AT_HOME,
    BASE,
    BOX_B_FREE,
    HOME,
    MOVE_ARM,
    MOVE_BASE,
    Play,
    arm,
    base,
    opened,
    play,
)

from tca_behaviours.coordination import (
    Activity,
    Coordination,
    Discrete,
    Do,
    Perceived,
    Prior,
    Situation,
)
from tca_module import ExceptionHandler, Module, Task, TaskFailed, connect
from tca_wire.coordination import read_report
from tca_wire.journal.facts import StateChanged

FACTS = AT_HOME | {"lid": "shut"}


def fork(free: Activity, *taken: Activity) -> Coordination:
    """Return a machine in which the base drives to B. Then *free* follows if box B is free,
    otherwise the activities *taken*.
    """
    with Coordination("fork", facts=FACTS) as machine:
        to_b, if_free, end = (
            machine.state("to B", base("B")),
            machine.state("free", free),
            machine.final("end"),
        )
        states = [
            machine.state(f"taken {number}", activity) for number, activity in enumerate(taken, 1)
        ]
        to_b.to(if_free, when=BOX_B_FREE, likelihood=Perceived(BOX_B_FREE))
        to_b.to(states[0], likelihood=Perceived(BOX_B_FREE, negated=True))
        if_free.to(end)
        for state, following in zip(states, [*states[1:], end], strict=True):
            state.to(following)
    return machine


def events_after_mistake(run: Play) -> list[str]:
    """Take box B after early work is done. Return the events from then on."""
    run.start_with_wrong_prediction()
    return [line for line in run.event_lines() if float(line.split()[0]) > 4]


def test_early_result_survives_a_short_wrong_observation() -> None:
    """A wrong observation lasts one second. The arm stays in place, and the result of its move is
    kept.
    """
    with play(fork(arm("box B", undo=HOME), opened(arm="home")), AS_SOON_AS_LIKELY) as run:
        ran = run.start(seconds=4)
        run.box_b(0.0)
        run.central.advance(1)
        run.box_b(1.0)
        run.central.advance(20)
        assert [line for line in run.event_lines() if "arm to" in line] == [
            "0 arm to box B: ahead",
            "3 arm to box B: done",
            "8 arm to box B: kept",
        ]
        assert ran.result(timeout=5).wasted == 0


def test_early_result_is_not_undone_when_overwritten() -> None:
    with play(
        fork(arm("box B", undo=HOME), arm("box C"), opened(arm="box C", base="B")),
        AS_SOON_AS_LIKELY,
    ) as run:
        assert "arm to home: restoring" not in " ".join(events_after_mistake(run))
        assert run.event_lines()[-1].endswith("-> end (done)")


def test_partly_overwritten_early_result_is_undone() -> None:
    both = Activity(Do(MOVE_ARM, "box B", ARM), makes={"arm": "box B", "lid": "open"}, undo=HOME)
    with play(fork(both, arm("box C"), opened(lid="shut", arm="box C")), AS_SOON_AS_LIKELY) as run:
        assert events_after_mistake(run) == [
            "8 base to B: done",
            "8 -> taken 1 (done)",
            "8 arm to box B: wasted",
            "8 arm to home: restoring",
            "11 arm to home: done",
            "11 arm to box C: current",
            "14 arm to box C: done",
            "14 -> taken 2 (done)",
            "14 gripper open: current",
            "15 gripper open: done",
            "15 -> end (done)",
        ]


def test_run_end_undoes_wasted_early_work() -> None:
    """The next run assumes that the arm is at home."""
    with play(fork(arm("box B", undo=HOME), opened()), AS_SOON_AS_LIKELY) as run:
        assert events_after_mistake(run)[-2:] == [
            "8 arm to home: restoring",
            "11 arm to home: done",
        ]


def test_work_without_undo_is_not_started_early() -> None:
    with play(fork(arm("box B"), opened()), AS_SOON_AS_LIKELY) as run:
        assert "arm" not in " ".join(events_after_mistake(run))


def test_early_task_that_never_started_is_not_undone() -> None:
    """The arm is locked, so its early task stays queued until it is stopped."""
    with play(fork(arm("box B", undo=HOME), opened(arm="home")), AS_SOON_AS_LIKELY) as run:
        with connect("locker", run.central) as locker, locker.lock("arm"):
            assert "8 -> end (done)" in events_after_mistake(run)
        assert "arm to home" not in " ".join(run.event_lines())


def test_failed_undo_fails_the_state_that_needs_it() -> None:
    ahead = arm("box B", undo=Do(MOVE_ARM, "stuck", ARM))
    with play(fork(ahead, opened(arm="home")), AS_SOON_AS_LIKELY) as run:
        ran = run.start_with_wrong_prediction()
        with pytest.raises(
            TaskFailed, match="'taken 1' can't begin: 'arm' must be 'home' and is unknown"
        ):
            ran.result(timeout=5)


def test_state_cannot_start_on_facts_of_wasted_early_work() -> None:
    with play(fork(arm("box B", undo=HOME), opened(arm="box B")), AS_SOON_AS_LIKELY) as run:
        ran = run.start_with_wrong_prediction()
        with pytest.raises(
            TaskFailed, match="'taken 1' can't begin: 'arm' must be 'box B' and is 'home'"
        ):
            ran.result(timeout=5)
        assert run.event_lines()[-2:] == ["8 -> taken 1 (done)", "8 arm to box B: wasted"]


def test_early_work_is_not_kept_when_its_needs_are_unmet() -> None:
    """The path that skips the arm is unlikely, but is taken at the last moment. Without a preview
    the arm would not be there.
    """
    with Coordination("past", facts=FACTS) as machine:
        to_b, reach = (
            machine.state("to B", base("B")),
            machine.state("reach", arm("box B", undo=HOME)),
        )
        drop, end = machine.state("drop", opened(arm="box B")), machine.final("end")
        to_b.to(reach, when=BOX_B_FREE, likelihood=Prior(0.9))
        to_b.to(drop, likelihood=Prior(0.1))
        reach.to(drop)
        drop.to(end)
    with play(machine, AS_SOON_AS_LIKELY) as run:
        run.box_b(0.0)
        ran = run.begin()
        run.central.advance(30)
        assert "3 gripper open: ahead" in run.event_lines()
        with pytest.raises(TaskFailed, match="'drop' can't begin"):
            ran.result(timeout=5)


def test_guards_see_facts_as_without_early_work() -> None:
    def is_home(situation: Situation) -> bool:
        return situation.facts["arm"] == "home"

    with Coordination("guarded", facts=FACTS) as machine:
        to_b, reach = (
            machine.state("to B", base("B")),
            machine.state("reach", arm("box B", undo=HOME)),
        )
        lost, end = machine.final("lost"), machine.final("end")
        to_b.to(reach, when=is_home, likelihood=Prior(0.9))
        to_b.to(lost)
        reach.to(end)
    with play(machine, AS_SOON_AS_LIKELY) as run:
        ran = run.begin()
        run.central.advance(30)
        end_of_run = ran.result(timeout=5)
        assert (end_of_run.state, end_of_run.kept) == ("end", 1)


def test_endless_cycle_of_failing_states_fails_the_run() -> None:
    with Coordination("round", facts=FACTS) as machine:
        reach, grasp = (
            machine.state("reach", arm("stuck")),
            machine.state("grasp", opened(arm="stuck")),
        )
        reach.to(grasp)
        reach.to(grasp, on="failed")
        grasp.to(machine.final("end"))
        grasp.to(grasp, on="failed")
    with play(machine, None) as run:
        ran = run.begin()
        run.central.advance(5)
        with pytest.raises(TaskFailed, match="'grasp' can't begin"):
            ran.result(timeout=5)


def test_next_activity_waits_for_facts_that_a_left_one_needs() -> None:
    robot = Module("robot")

    @robot.handles(MOVE_BASE, resource="base", takes=["cancel"])
    def drive(task: Task, _: str) -> None:
        task.wait_for_request()
        task.sleep(2)  # stops slowly
        raise task.aborted()

    @robot.handles(MOVE_ARM, resource="arm")
    def move(_: Task, __: str) -> None: ...

    careful = Activity(Do(MOVE_BASE, "B", BASE), needs={"arm": "home"})
    with Coordination("careful", facts=FACTS) as machine:
        there, wave, end = (
            machine.state("there", careful),
            machine.state("wave", arm("up")),
            machine.final("end"),
        )
        there.to(end)
        there.to(wave, on="greet")
        wave.to(end)
    with play(machine, None, robot) as run:
        run.begin()
        run.event("greet")
        run.central.advance(5)
        assert run.event_lines() == [
            "0 base to B: current",
            "0 -> wave (greet)",
            "2 base to B: killed",
            "2 arm to up: current",
            "2 arm to up: done",
            "2 -> end (done)",
        ]


def test_recovered_run_failure_stops_early_work() -> None:
    shrug = ExceptionHandler("shrug")
    carefree = Module("carefree")
    carefree.handles(shrug)(lambda _: None)
    with Coordination("both", facts=FACTS) as machine:
        reach, drive = machine.state("reach", arm("stuck")), machine.state("drive", base("B"))
        reach.to(drive)
        drive.to(machine.final("end"))
    with play(machine, AS_SOON_AS_LIKELY) as run:
        carefree.central = run.central
        with carefree.running():
            run.user.on_failure(None, shrug)
            run.begin()
            run.central.advance(1)
            assert "0 base to B: ahead" in run.event_lines()
            assert run.user.tasks() == []


def test_coordination_report_is_sent_on_change_only() -> None:
    with play(fork(arm("box B"), arm("box C")), Discrete(2.0)) as run:
        run.box_b(1.0)
        run.begin()
        run.central.advance(2)  # the base reports its progress
        run.box_b(0.0)
        run.box_b(0.0)
        reports = [
            read_report(fact.body) for fact in run.central.facts if isinstance(fact, StateChanged)
        ]
        chart = run.coordinator.chart
        assert [
            [chart.states[one.state].label for one in report.preview]
            for report in reports
            if report
        ] == [
            ["free", "end"],
            ["taken 1", "end"],
        ]
