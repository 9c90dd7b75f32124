"""A run is a task of the tree. Exception handlers retry it, and it holds locks."""

from missions.gripper import Gripper, serving

from tca_behaviours.missions import MISSION_TASK_FAILED, OnceTask, PeriodicTask, Status
from tca_module import ExceptionHandler, Goal, Module, Outcome, Task

AGAIN, PICK = ExceptionHandler("again"), Goal("pick")


class Close(PeriodicTask[Gripper]):
    """Close with a given force."""

    force: float = 1.0
    speed: float = 1.0

    def iterate(self) -> Status:
        self.env.note(self, f"with {self.force:g} at {self.speed:g}")
        if self.force < 3:
            raise self.failed("it slips")
        return Status.COMPLETED

    def terminate(self) -> None:
        self.env.note(self, "lets go")


class Wait(PeriodicTask[Gripper]):
    """Fail once a parameter says so."""

    speed: float = 1.0
    fails: bool = False
    tries: int = 0

    def iterate(self) -> Status:
        self.env.note(self, f"{self.speed:g} {self.tries}")
        if self.fails and not any("again" in note for note in self.env.notes):
            self.env.notes.append("again")
            raise self.failed("as it was told")
        return Status.COMPLETED if self.fails else Status.RUNNING


def test_exception_handler_retries_a_run_with_new_parameters() -> None:
    with serving(Close) as robot:
        close, planner = robot.server.definitions["Close"], Module("planner", robot.central)

        @planner.handles(AGAIN)
        def again(task: Task) -> None:
            failing = task.trouble.failing
            force = failing.data(close.message).force + 1
            failing.retry(close.message, close.parameters(force=force))

        @planner.handles(PICK)
        def pick(task: Task) -> None:
            task.ref.on_failure(MISSION_TASK_FAILED, AGAIN)
            task.command(close.message, close.parameters(force=1.0))

        with planner.running():
            picked = robot.user.goal(PICK)
            robot.after(1)
            assert picked.wait(0) is Outcome.DONE


def test_retried_run_keeps_updated_parameters() -> None:
    with serving(Wait, rate=1) as robot:
        wait, planner = robot.server.definitions["Wait"], Module("planner", robot.central)

        @planner.handles(AGAIN)
        def again(task: Task) -> None:
            task.trouble.failing.retry()

        with planner.running():
            robot.user.on_failure(MISSION_TASK_FAILED, AGAIN)
            sent = robot.send("Wait", tries=7)
            robot.after(0.5)
            sent.update(wait.parameters(speed=4.0), timeout=5)
            sent.update(wait.parameters(fails=True), timeout=5)
            assert robot.after(3) == ["1.00 Wait 4 7", "again", "1.00 Wait 4 7"]


def test_run_holds_its_lock_until_it_ends() -> None:
    class Calibrate(OnceTask[Gripper]):
        def iterate(self) -> None:
            with self.task.lock("lens", module="camera"):
                self.env.note(self, "has the lens")
                self.sleep(1.0)

    with serving(Calibrate) as robot:
        camera = Module("camera", robot.central)
        camera.resource("lens")
        look = Goal("look")
        camera.handles(look, resource="lens")(lambda _: None)
        with camera.running():
            first = robot.send("Calibrate", foreground=False)
            robot.send("Calibrate", foreground=False)
            assert robot.after(0.5) == ["0.00 Calibrate has the lens"]
            first.kill()
            assert robot.after(0) == ["0.50 Calibrate has the lens"]
