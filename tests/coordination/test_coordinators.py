"""Coordinators without a preview: failures, events, waiting guards, ends, and refusals."""

from threading import Event

import pytest
from coordination.delivery_robot import (
    ARM,
    AS_SOON_AS_LIKELY,
    AT_HOME,
    BASE,
    BOX_B_FREE,
    FINGERS,
    GRIPPER,
    MOVE_ARM,
    MOVE_BASE,
    STUCK,
    arm,
    base,
    delivery,
    opened,
    play,
)

from tca_behaviours.coordination import (
    COORDINATION_EVENT,
    Activity,
    Coordination,
    Coordinator,
    Do,
    MachineEvent,
)
from tca_behaviours.coordination.model.interpreter import Interpreter
from tca_module import (
    Command,
    ExceptionHandler,
    MisuseError,
    Module,
    Outcome,
    Recovery,
    Task,
    TaskFailed,
    connect,
)
from tca_module.testing import LocalCentral


def reaching(place: str) -> Coordination:
    with Coordination("reach", facts=AT_HOME) as machine:
        machine.state("reaching", arm(place)).to(machine.final("end"))
    return machine


def driving() -> Coordination:
    """Return a machine whose base drives until it arrives, or until a noise."""
    with Coordination("drive", facts=AT_HOME) as machine:
        there, end = machine.state("there", base("B")), machine.final("end")
        there.to(end)
        there.to(end, on="noise")
    return machine


def test_failure_without_an_arrow_fails_the_run() -> None:
    with play(reaching("stuck"), None) as run:
        ran = run.begin()
        run.central.advance(2)
        with pytest.raises(TaskFailed) as failed:
            ran.result(timeout=5)
        assert failed.value.failure == STUCK.name
        assert failed.value.data_as(STUCK) == 0.5
        assert run.user.tasks() == []


def test_exception_handler_of_the_run_can_retry_a_task() -> None:
    again = ExceptionHandler("again", float)
    expert = Module("expert")

    @expert.handles(again)
    def try_again(task: Task, _: float) -> None:
        assert task.trouble.failing.message == MOVE_ARM.name
        task.trouble.failing.retry(MOVE_ARM, "home")

    with play(reaching("stuck"), None) as run:
        expert.central = run.central
        with expert.running():
            ran = run.begin(on_failure=[Recovery(STUCK, again)])
            run.central.advance(5)
            assert ran.result(timeout=5).state == "end"


def test_subtask_failure_fails_the_activity() -> None:
    robot = Module("robot")
    part = Command("part of it")

    @robot.handles(MOVE_ARM, resource="arm")
    def move(task: Task, _: str) -> None:
        task.command(part)
        task.sleep(5)

    @robot.handles(part, resource="part")
    def fail(_: Task) -> None:
        raise STUCK(2.5, "it is heavy")

    with play(reaching("box B"), None, robot) as run:
        ran = run.begin()
        with pytest.raises(TaskFailed, match="it is heavy"):
            ran.result(timeout=5)


def test_killed_task_fails_the_activity() -> None:
    with play(reaching("box B"), None) as run:
        ran = run.begin()
        run.user.tasks(MOVE_ARM)[0].kill("not now")
        run.central.until_quiet()
        with pytest.raises(TaskFailed, match=r"activity stopped.*'reaching'.*was killed: not now"):
            ran.result(timeout=5)


def lost() -> Coordination:
    """Return a machine whose arm moves or fails. The next state needs the arm in its new place."""
    with Coordination("lost", facts=AT_HOME) as machine:
        reach = machine.state("reaching", arm("stuck"))
        grasp = machine.state("grasping", opened(arm="stuck"))
        end, given_up = machine.final("end"), machine.state("giving up", base("A"))
        reach.to(grasp)
        reach.to(grasp, on="failed")
        grasp.to(end)
        given_up.to(end)
        reach.to(given_up, on="give up")
    return machine


def test_state_with_unmet_needs_fails_the_run() -> None:
    with play(lost(), None) as run:
        ran = run.begin()
        run.central.advance(2)
        with pytest.raises(
            TaskFailed, match="'grasping' can't begin: 'arm' must be 'stuck' and is unknown"
        ):
            ran.result(timeout=5)


def test_state_with_unmet_needs_takes_its_failed_arrow() -> None:
    with Coordination("careful", facts=AT_HOME) as machine:
        reach = machine.state("reaching", arm("stuck"))
        grasp = machine.state("grasping", opened(arm="stuck"))
        stow = machine.state("stowing", arm("home"))
        end = machine.final("end")
        reach.to(grasp)
        reach.to(grasp, on="failed")
        grasp.to(end)
        grasp.to(stow, on="failed")
        stow.to(end)
    with play(machine, AS_SOON_AS_LIKELY) as run:
        ran = run.begin()
        run.central.advance(10)
        assert run.event_lines() == [
            "0 arm to stuck: current",
            "0.5 arm to stuck: failed",
            "0.5 -> grasping (failed)",
            "0.5 -> stowing (failed)",
            "0.5 arm to home: current",
            "3.5 arm to home: done",
            "3.5 -> end (done)",
        ]
        assert ran.result(timeout=5).state == "end"


def test_next_activity_waits_for_a_slow_cancel_of_its_agent() -> None:
    robot = Module("robot")

    @robot.handles(MOVE_BASE, resource="base", takes=["cancel"])
    def drive(task: Task, _: str) -> None:
        task.wait_for_request()
        task.sleep(2)  # stops slowly
        raise task.aborted()

    @robot.handles(GRIPPER, resource="horn")
    def honk(task: Task, _: str) -> None:
        task.sleep(1)

    with Coordination("drive", facts=AT_HOME) as machine:
        there, look = (
            machine.state("there", base("B")),
            machine.state("look", Activity(Do(GRIPPER, "horn", BASE))),
        )
        end = machine.final("end")
        there.to(end)
        there.to(look, on="noise")
        look.to(end)
    with play(machine, None, robot) as run:
        run.begin()
        run.central.advance(1)
        run.event("noise")
        run.central.advance(10)
        assert run.event_lines() == [
            "0 base to B: current",
            "1 -> look (noise)",
            "3 base to B: killed",
            "3 gripper horn: current",
            "4 gripper horn: done",
            "4 -> end (done)",
        ]


def test_uncancellable_task_is_killed_after_patience() -> None:
    robot = Module("robot")

    @robot.handles(MOVE_BASE, resource="base", refuses=["cancel"])
    def drive(task: Task, _: str) -> None:
        task.sleep(100)

    with play(driving(), None, robot, patience=2.0) as run:
        ran = run.begin()
        run.event("noise")
        run.central.advance(10)
        assert run.event_lines() == [
            "0 base to B: current",
            "0 -> end (noise)",
            "2 base to B: killed",
        ]
        assert ran.wait(timeout=5) is Outcome.DONE


def test_run_end_waits_for_a_shielded_task() -> None:
    robot = Module("robot")

    @robot.handles(MOVE_BASE, resource="base", refuses=["cancel"])
    def drive(task: Task, _: str) -> None:
        with task.shielded():
            task.sleep(8)

    with play(driving(), None, robot, patience=2.0) as run:
        ran = run.begin()
        run.event("noise")
        run.central.advance(7)
        assert ran.info() is not None
        run.central.advance(2)
        assert ran.wait(timeout=5) is Outcome.DONE


def test_guard_is_evaluated_again_when_a_variable_changes() -> None:
    with Coordination("gate", facts=AT_HOME) as machine:
        there, end = machine.state("there", base("B")), machine.final("end")
        there.to(end, when=BOX_B_FREE)
    with play(machine, None) as run:
        ran = run.begin()
        run.central.advance(10)
        assert ran.state == "running"
        run.box_b(0.2)
        assert ran.state == "running"
        run.box_b(0.9)
        assert ran.wait(timeout=5) is Outcome.DONE


def test_tasks_of_one_activity_start_and_fail_together() -> None:
    both = Activity(
        Do(MOVE_BASE, "B", BASE), Do(MOVE_ARM, "stuck", ARM), Do(GRIPPER, "open", FINGERS)
    )
    with Coordination("both", facts=AT_HOME) as machine:
        work, end = machine.state("work", both), machine.final("end")
        work.to(end)
        work.to(end, on="failed")
    with play(machine, None) as run:
        run.begin()
        run.central.advance(10)
        assert run.event_lines() == [
            "0 base to B: current",
            "0 arm to stuck: current",
            "0 gripper open: current",
            "0.5 arm to stuck: failed",
            "0.5 base to B: killed",
            "0.5 gripper open: killed",
            "0.5 -> end (failed)",
        ]


def test_event_without_an_arrow_is_dropped() -> None:
    with play(delivery(), None) as run:
        run.event("object given")  # no run exists
        run.box_b(0.0)
        run.begin()
        run.event("box kicked")
        assert run.event_lines() == []
        run.coordinator.post("object given")
        run.central.until_quiet()
        run.event("done")  # the name of an activity's own event
        assert run.event_lines() == ["0 -> going to B (object given)", "0 base to B: current"]
        with pytest.raises(MisuseError, match="has no event 'kick': there are object given"):
            run.coordinator.post("kick")


def test_run_of_another_machine_of_that_name_is_rejected() -> None:
    with Coordination("deliver", facts=AT_HOME) as other:
        other.state("there", base("B")).to(other.final("end"))
    with play(delivery(), None) as run:
        ran = run.user.command(run.coordinator.message, Coordinator(other).chart)
        with pytest.raises(TaskFailed, match="machine 'deliver' has another structure here"):
            ran.result(timeout=5)


def test_coordinator_run_returns_the_end_state() -> None:
    with Coordination("nothing") as machine:
        machine.state("open", opened()).to(machine.final("end"))
    robot = Module("robot")

    @robot.handles(GRIPPER)
    def do(_: Task, __: str) -> None: ...

    with play(machine, None, robot) as run:
        assert run.coordinator.run(run.user).state == "end"


def test_event_sent_right_after_the_start_reaches_the_run() -> None:
    with Coordination("long", facts=AT_HOME) as machine:
        waiting, end = machine.state("waiting"), machine.final("end")
        moves = [machine.state(f"move {number}", arm("box B")) for number in range(300)]
        waiting.to(moves[0], on="go")
        waiting.to(end, on="stop")
        for move, following in zip(moves, [*moves[1:], end], strict=True):
            move.to(following)
    coordinator, module = Coordinator(machine), Module("coordinator")
    coordinator.handle_in(module)
    with LocalCentral() as central, connect("user", central) as user:
        module.central = central
        with module.running():
            for _ in range(5):  # consecutive runs share one interpreter
                run = user.command(coordinator.message, coordinator.chart)
                user.broadcast(COORDINATION_EVENT, MachineEvent("long", "stop"))
                assert run.result(timeout=5).state == "end"


def test_event_for_a_failed_start_does_not_reach_the_next_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """An event for the first run arrives. Then this run fails before it listens for events."""
    begins, event_sent, restart = Event(), Event(), Interpreter.restart

    def fail_once(interpreter: Interpreter, now: float) -> None:
        if not begins.is_set():
            begins.set()
            assert event_sent.wait(5)
            raise RuntimeError("no chart today")
        restart(interpreter, now)

    coordinator, module = Coordinator(delivery(), policy=None), Module("coordinator")
    coordinator.handle_in(module)
    monkeypatch.setattr(Interpreter, "restart", fail_once)
    with LocalCentral() as central, connect("user", central) as user:
        module.central = central
        with module.running():
            first = user.command(coordinator.message, coordinator.chart)
            assert begins.wait(5)
            user.broadcast(COORDINATION_EVENT, MachineEvent("deliver", "object given"))
            central.until_quiet(ignoring=[coordinator.message])
            event_sent.set()
            with pytest.raises(TaskFailed, match="no chart today"):
                first.result(timeout=5)
            second = user.command(coordinator.message, coordinator.chart)
            assert next(iter(second.progress())).current == 0
            central.until_quiet()
            assert user.tasks(MOVE_BASE) == []
            second.kill("enough")


def test_module_accepts_one_coordinator() -> None:
    module = Module("coordinator")
    Coordinator(lost()).handle_in(module)
    with pytest.raises(
        MisuseError, match="has a coordinator already: handle machine 'deliver' in another module"
    ):
        Coordinator(delivery()).handle_in(module)
