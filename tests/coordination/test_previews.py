"""Runs with a preview, on a stepped clock: early work is started, kept, dropped and undone."""

import re
from typing import Any

import pytest
from coordination.delivery_robot import (
    ARM,
    AS_SOON_AS_LIKELY,
    AT_HOME,
    BOX_B_FREE,
    FINGERS,
    GRIPPER,
    HOME,
    MOVE_ARM,
    MOVE_BASE,
    STUCK,
    arm,
    base,
    delivery,
    make_driving_base,
    opened,
    play,
)

from tca_behaviours.coordination import (
    Activity,
    Agent,
    Continuous,
    Coordination,
    Discrete,
    Do,
    Perceived,
    Policy,
    Prior,
)
from tca_module import Command, ExceptionHandler, Module, Outcome, Task, TaskFailed, connect


def fork(free: Activity, taken: Activity, first: Activity | None = None) -> Coordination:
    """Return a machine in which the base drives to B. Then *free* follows if box B is free,
    otherwise *taken*.
    """
    with Coordination("fork", facts=AT_HOME) as machine:
        to_b = machine.state("to B", first or base("B"))
        if_free, if_taken = machine.state("free", free), machine.state("taken", taken)
        end = machine.final("end")
        to_b.to(if_free, when=BOX_B_FREE, likelihood=Perceived(BOX_B_FREE))
        to_b.to(if_taken, likelihood=Perceived(BOX_B_FREE, negated=True))
        if_free.to(if_taken, on="failed")
        for state in (if_free, if_taken):
            state.to(end)
    return machine


def test_arm_moves_early_while_the_base_drives() -> None:
    with play(delivery()) as run:
        ran = run.start("object given", seconds=30)
        assert run.event_lines() == [
            "0 -> going to B (object given)",
            "0 base to B: current",
            "2 arm to box B: ahead",
            "5 arm to box B: done",
            "8 base to B: done",
            "8 -> arm to box B (done [box B is free])",
            "8 -> dropping in B (done)",
            "8 arm to box B: kept",
            "8 gripper open: current",
            "9 gripper open: done",
            "9 -> tucking (done)",
            "9 arm to tuck: current",
            "12 arm to tuck: done",
            "12 -> going back (done)",
            "12 base to A: current",
            "20 base to A: done",
            "20 -> end (done)",
        ]
        end = ran.result(timeout=5)
        assert (end.state, end.transitions, end.kept, end.wasted) == ("end", 6, 1, 0)


def test_no_early_work_starts_without_a_policy() -> None:
    with play(delivery(), None) as run:
        ran = run.start("object given", seconds=30)
        assert [line for line in run.event_lines() if line.startswith(("8 ", "11 "))] == [
            "8 base to B: done",
            "8 -> arm to box B (done [box B is free])",
            "8 arm to box B: current",
            "11 arm to box B: done",
            "11 -> dropping in B (done)",
            "11 gripper open: current",
        ]
        assert ran.result(timeout=5).kept == 0


def test_changed_observation_replaces_early_work() -> None:
    with play(delivery(), AS_SOON_AS_LIKELY) as run:
        ran = run.start_with_wrong_prediction("object given", seconds=1, later=40)
        assert run.event_lines()[:13] == [
            "0 -> going to B (object given)",
            "0 base to B: current",
            "0 arm to box B: ahead",
            "1 arm to box B: killed",
            "1 arm to box B: wasted",
            "1 arm to box C: ahead",
            "4 arm to box C: done",
            "8 base to B: done",
            "8 -> going to C (done)",
            "8 base to C: current",
            "16 base to C: done",
            "16 -> arm to box C (done)",
            "16 -> dropping in C (done)",
        ]
        end = ran.result(timeout=5)
        assert (end.kept, end.wasted) == (1, 1)


def test_early_work_is_undone_for_a_state_needing_the_old_fact() -> None:
    ahead = arm("box B", undo=HOME)
    with play(fork(ahead, opened(arm="home")), AS_SOON_AS_LIKELY) as run:
        ran = run.start_with_wrong_prediction()
        assert run.event_lines() == [
            "0 base to B: current",
            "0 arm to box B: ahead",
            "3 arm to box B: done",
            "8 base to B: done",
            "8 -> taken (done)",
            "8 arm to box B: wasted",
            "8 arm to home: restoring",
            "11 arm to home: done",
            "11 gripper open: current",
            "12 gripper open: done",
            "12 -> end (done)",
        ]
        assert ran.result(timeout=5).wasted == 1


def test_early_greeting_is_not_reused_for_the_next_visitor() -> None:
    """The first visitor has left before the robot reaches the door. The early greeting must not
    count for the second visitor.
    """
    seen = Perceived(BOX_B_FREE)
    with Coordination("patrol", facts={"base": "A"}) as machine:
        waiting, to_door = machine.state("waiting"), machine.state("to the door", base("B"))
        greet = machine.state("greet", Activity(Do(GRIPPER, "hello", FINGERS)))
        back = machine.state("back", base("A"))
        waiting.to(to_door, on="go")
        waiting.to(machine.final("end"), on="stop")
        to_door.to(greet, when=BOX_B_FREE, likelihood=seen)
        to_door.to(back, likelihood=Perceived(BOX_B_FREE, negated=True))
        greet.to(back)
        back.to(waiting)
    with play(machine, AS_SOON_AS_LIKELY) as run:
        ran = run.begin()
        run.box_b(1.0)
        run.event("go")
        run.central.advance(3)
        run.box_b(0.0)
        run.central.advance(27)
        run.event("go")
        run.central.advance(2)
        run.box_b(1.0)
        run.central.advance(30)
        run.event("stop")
        assert [line for line in run.event_lines() if "hello" in line or "greet" in line] == [
            "0 gripper hello: ahead",
            "1 gripper hello: done",
            "8 gripper hello: wasted",
            "32 gripper hello: ahead",
            "33 gripper hello: done",
            "38 -> greet (done [box B is free])",
            "38 gripper hello: kept",
        ]
        end = ran.result(timeout=5)
        assert (end.kept, end.wasted) == (1, 1)


def test_failed_undo_is_logged(caplog: pytest.LogCaptureFixture) -> None:
    robot = make_driving_base()

    @robot.handles(MOVE_ARM, resource="arm")
    def move(_: Task, place: str) -> None:
        if place == "home":
            raise STUCK(0.5, "jammed")

    with play(fork(arm("box B", undo=HOME), base("C")), AS_SOON_AS_LIKELY, robot) as run:
        ran = run.start_with_wrong_prediction()
        assert ran.result(timeout=5).wasted == 1
    assert "did not undo wasted early work" in caplog.text


def test_early_task_queues_behind_other_tasks() -> None:
    robot, places = make_driving_base(), list[str]()

    @robot.handles(MOVE_ARM, resource="arm")
    def move(_: Task, place: str) -> None:
        places.append(place)

    with play(fork(arm("box B"), arm("home")), AS_SOON_AS_LIKELY, robot) as run:
        run.box_b(1.0)
        with connect("locker", run.central) as locker, locker.lock("arm"):
            run.begin()
            run.user.command(MOVE_ARM, "look around", sequential=False)
            run.central.until_quiet()
        run.central.advance(5)
    assert places == ["look around", "box B"]


def test_work_without_undo_waits_for_its_state() -> None:
    with play(fork(arm("box B"), opened(arm="home")), AS_SOON_AS_LIKELY) as run:
        run.start(seconds=20)
        assert "8 arm to box B: current" in run.event_lines()


def test_slow_early_task_gets_full_speed_on_state_entry() -> None:
    robot = Module("robot")
    speeds: list[tuple[float, str]] = []

    @robot.handles(MOVE_BASE, resource="base")
    def drive(task: Task, _: str) -> None:
        task.sleep(4)
        task.report(0.5)
        task.sleep(4)

    @robot.handles(MOVE_ARM, resource="arm", takes=["update"])
    def move(task: Task, speed: str) -> None:
        speeds.append((task.time(), speed))
        if request := task.wait_for_request(10):
            speeds.append((task.time(), request.goal))
            request.accept()

    ahead = arm("full speed", adapt=lambda _, share, __: f"at {share:g}", undo=HOME)
    policy = Continuous(0.0, 1.0, utility=lambda candidate: candidate.progress_before)
    with play(fork(ahead, opened()), policy, robot) as run:
        run.start(seconds=20)
    assert speeds == [(4.0, "at 0.5"), (8.0, "full speed")]


def test_agent_with_capacity_two_ranks_its_tasks() -> None:
    robot = make_driving_base()
    records: list[tuple[float, str]] = []
    robot.resource("arms", capacity=2)

    @robot.handles(MOVE_ARM, resource="arms", takes=["update"])
    def solve(task: Task, weight: str) -> None:
        records.append((task.time(), weight))
        while request := task.wait_for_request(20):
            records.append((task.time(), request.goal))
            request.accept()

    solver = Agent("solver", tasks=2)
    with Coordination("solve", facts={"base": "A"}) as machine:
        states = [machine.state("to B", base("B"))]
        states += [
            machine.state(
                name,
                Activity(Do(MOVE_ARM, name, solver), adapt=lambda name, _, rank: f"{name} {rank}"),
            )
            for name in ("look", "hold")
        ]
        for state, following in zip(states, [*states[1:], machine.final("end")], strict=True):
            state.to(following)
    with play(machine, AS_SOON_AS_LIKELY, robot) as run:
        run.begin()
        run.central.advance(60)
    assert sorted(records) == [
        (0.0, "hold 2"),
        (0.0, "look 1"),
        (8.0, "hold 1"),
        (8.0, "look"),
    ]


def test_failing_preview_function_does_not_end_the_run(caplog: pytest.LogCaptureFixture) -> None:
    """The functions raise, or return no number. Each failure is logged once, and the arm does not
    move early.
    """

    def wrong(*_: object) -> float:
        return 1 / 0

    all_options: tuple[dict[str, Any], ...] = (
        {"cost": lambda _: float("nan")},
        {"adapt": wrong},
        {"adapt": lambda *_: 5},
        {},
        {},
        {},
    )
    policies = (
        Continuous(),
        *2 * [Continuous(0.0, 2.0, utility=lambda _: 1.0)],
        Discrete(0.2, wrong),
        Odd(),
        AS_SOON_AS_LIKELY,
    )
    for options, policy in zip(all_options, policies, strict=True):
        likelihood = wrong if policy is AS_SOON_AS_LIKELY else lambda _: 0.1 + 0.2 + 0.7 + 1e-15
        with Coordination("fork", facts=AT_HOME) as machine:
            to_b, reach = (
                machine.state("to B", base("B")),
                machine.state("reach", arm("box B", **options)),
            )
            to_b.to(reach, likelihood=likelihood)
            reach.to(machine.final("end"), likelihood=Prior(0.0))
        caplog.clear()
        with play(machine, policy) as run:
            ran = run.begin()
            run.central.advance(20)
            assert ran.result(timeout=5).kept == 0
        assert len([one for one in caplog.records if re.search(r": \w+: ", one.message)]) == 1, (
            options
        )


def test_invalid_progress_of_early_task_does_not_end_the_run(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """The progress function raises, or returns no number. The error is logged once. It counts only
    when the state is entered.
    """

    def unread(report: float) -> float:
        return report["done"]  # type: ignore[index,no-any-return]

    for progress in (unread, lambda _: "half way"):
        caplog.clear()
        with play(fork(arm("box B", progress=progress, undo=HOME), base("C"))) as run:
            ran = run.start_with_wrong_prediction(seconds=5.2)
            end = ran.result(timeout=5)
            assert (end.state, end.wasted) == ("end", 1)
        records = [one.message for one in caplog.records if one.name == "tca.coordinator"]
        assert len(records) == 1
        assert 'the progress of Activity(arm to "box B") does not change: ' in records[0]


def test_invalid_progress_of_current_task_fails_the_run() -> None:
    with play(fork(arm("box B", progress=lambda _: "half way"), base("C")), Discrete(2.0)) as run:
        ran = run.start(seconds=30)
        with pytest.raises(TaskFailed, match="could not convert string to float"):
            ran.result(timeout=5)


def test_undo_task_may_report_any_progress_type() -> None:
    unfold = Command("unfold", progress=str)
    robot = make_driving_base()

    @robot.handles(MOVE_ARM, resource="arm")
    def move(task: Task, _: str) -> None:
        task.sleep(3)

    @robot.handles(GRIPPER)
    def open_it(task: Task, _: str) -> None: ...

    @robot.handles(unfold, resource="arm")
    def work(task: Task) -> None:
        task.report("half way")
        task.sleep(1)

    with play(
        fork(arm("box B", undo=Do(unfold, None, ARM)), opened(arm="home")), AS_SOON_AS_LIKELY, robot
    ) as run:
        ran = run.start_with_wrong_prediction()
        assert ran.result(timeout=5).wasted == 1


class Odd(Policy):
    """A policy whose shares are out of range."""

    def wanted(self, utility: float) -> float:
        return 7.0


def test_failure_of_early_work_does_not_fail_the_run() -> None:
    with play(fork(arm("stuck"), arm("home")), AS_SOON_AS_LIKELY) as run:
        ran = run.start(seconds=20)
        assert run.event_lines() == [
            "0 base to B: current",
            "0 arm to stuck: ahead",
            "0.5 arm to stuck: failed",
            "0.5 arm to stuck: wasted",
            "8 base to B: done",
            "8 -> free (done [box B is free])",
            "8 arm to stuck: current",
            "8.5 arm to stuck: failed",
            "8.5 -> taken (failed)",
            "8.5 arm to home: current",
            "11.5 arm to home: done",
            "11.5 -> end (done)",
        ]
        assert ran.result(timeout=5).wasted == 1


def test_exception_handler_can_retry_an_early_task() -> None:
    around = ExceptionHandler("go around", float)
    expert = Module("expert")

    @expert.handles(around)
    def go_around(task: Task, _: float) -> None:
        task.trouble.failing.retry(MOVE_ARM, "box B")

    with play(fork(arm("stuck"), arm("home")), AS_SOON_AS_LIKELY) as run:
        expert.central = run.central
        with expert.running():
            run.user.on_failure(STUCK, around, of=MOVE_ARM)
            ran = run.start(seconds=20)
            assert run.event_lines()[2:] == [
                "0.5 arm to stuck: failed",
                "8 base to B: done",
                "8 -> free (done [box B is free])",
                "8 -> end (done)",
                "8 arm to stuck: kept",
            ]
            assert ran.result(timeout=5).kept == 1


def test_kill_of_the_run_ends_all_its_tasks() -> None:
    with play(delivery(), AS_SOON_AS_LIKELY) as run:
        ran = run.start("object given", seconds=1)
        ran.kill("enough")
        run.central.until_quiet()
        assert ran.wait(timeout=5) is Outcome.KILLED
        assert run.user.tasks() == []


def test_suspended_run_starts_no_task() -> None:
    with play(delivery(), AS_SOON_AS_LIKELY) as run:
        run.box_b(0.0)
        ran = run.begin()
        ran.suspend()
        run.event("object given")
        run.box_b(1.0)
        run.central.advance(20)
        assert [line for line in run.event_lines() if line.endswith("done")] == []
        ran.resume()
        run.central.advance(30)
        assert ran.wait(timeout=5) is Outcome.DONE


def test_module_stop_ends_all_tasks_of_the_run() -> None:
    with play(delivery(), AS_SOON_AS_LIKELY) as run:
        run.box_b(1.0)
        with connect("another", run.central) as other:
            ran = other.command(run.coordinator.message, run.coordinator.chart)
            run.central.until_quiet()
            run.event("object given")
            assert [task.message for task in other.tasks()] == [
                "coordinate deliver",
                "base to",
                "arm to",
            ]
            run.module.stop()
            run.central.until_quiet()
            assert ran.wait(timeout=5) is Outcome.FAILED
            assert other.tasks() == []


def test_early_work_inside_a_compound_is_kept_or_wasted() -> None:
    with Coordination("tour", facts=AT_HOME) as machine:
        with machine.compound("fetching") as fetching:
            to_b = machine.state("to B", base("B"))
            reach = machine.state("reach", arm("shelf"))
            have = machine.final("have it")
        bring = machine.state("bring", opened(arm="shelf", base="B"))
        rest = machine.state("rest", arm("home"))
        end = machine.final("end")
        to_b.to(reach)
        reach.to(have)
        fetching.to(bring)
        fetching.to(rest, on="forget it")
        bring.to(end)
        rest.to(end)
    with play(machine, AS_SOON_AS_LIKELY) as run:
        ran = run.begin()
        run.central.advance(20)
        assert run.event_lines() == [
            "0 base to B: current",
            "0 arm to shelf: ahead",
            "3 arm to shelf: done",
            "8 base to B: done",
            "8 -> reach (done)",
            "8 -> have it (done)",
            "8 -> bring (done)",
            "8 arm to shelf: kept",
            "8 gripper open: current",
            "9 gripper open: done",
            "9 -> end (done)",
        ]
        assert ran.result(timeout=5).transitions == 4
    with play(machine, AS_SOON_AS_LIKELY) as run:
        ran = run.begin()
        run.central.advance(1)
        run.event("forget it")
        run.central.advance(20)
        assert run.event_lines() == [
            "0 base to B: current",
            "0 arm to shelf: ahead",
            "1 base to B: killed",
            "1 arm to shelf: killed",
            "1 -> rest (forget it)",
            "1 arm to shelf: wasted",
            "1 arm to home: current",
            "4 arm to home: done",
            "4 -> end (done)",
        ]


def test_early_work_repeats_in_each_round_of_a_loop() -> None:
    """In a loop, the same activity may start early in each round."""
    with Coordination("rounds", facts=AT_HOME) as machine:
        there = machine.state("there", base("B"))
        grasp = machine.state("grasp", arm("down"))
        lift = machine.state("lift", arm("up", needs={"arm": "down"}))
        back = machine.state("back", base("A"))
        tidy = machine.state(
            "tidy",
            Activity(Do(MOVE_BASE, "A"), Do(MOVE_ARM, "home"), makes={"base": "A", "arm": "home"}),
        )
        tidy.to(machine.final("end"))
        there.to(grasp)
        grasp.to(lift)
        lift.to(back)
        back.to(there, likelihood=Prior(0.9))
        for state in (there, grasp, lift, back):
            state.to(tidy, on="enough")
    with play(machine, AS_SOON_AS_LIKELY) as run:
        run.begin()
        run.central.advance(40)
        run.event("enough")
        assert [
            line for line in run.event_lines() if not line.endswith(("done", "done)", "current"))
        ] == [
            "0 arm to down: ahead",
            "8 arm to down: kept",
            "8 base to A: ahead",
            "11 base to A: kept",
            "11 arm to down: ahead",
            "24 arm to down: kept",
            "24 base to A: ahead",
            "27 base to A: kept",
            "27 arm to down: ahead",
            "40 arm to down: kept",
            "40 base to A: ahead",
            "40 arm to up: killed",
            "40 base to A: killed",
            "40 -> tidy (enough)",
            "40 base to A: wasted",
        ]
