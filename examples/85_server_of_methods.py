"""A server with a method for each request: a camera turns to new goals while it watches."""

from tca_module import Command, Module, Outcome, Rejected, Server, Task, connect
from tca_module.testing import LocalCentral

WATCH = Command("watch", float, progress=float)

camera = Module("camera")


class Watching(Server[float, None]):
    def initiated(self, task: Task, goal: float) -> None:
        self.angle = goal
        while True:
            task.report(self.angle)
            task.sleep(1.0)  # the other methods are called while it waits

    def update(self, task: Task, goal: float) -> bool:
        if abs(goal) > 90:
            raise task.rejected("it turns by 90 degrees at most")
        self.angle = goal
        return True

    def cancel(self, task: Task, why: str) -> bool:
        task.report(0.0)  # it looks straight ahead again
        print("the shutter is closed:", why)
        return True


camera.serve(WATCH, Watching())


if __name__ == "__main__":
    with LocalCentral(stepped=True) as central:
        camera.central = central
        with camera.running(), connect("user", central) as user:
            watching = user.command(WATCH, 10.0)
            angles = watching.progress(float)
            print("looks at", next(angles))
            watching.update(30.0)
            central.advance(1.0)
            print("looks at", next(angles))
            try:
                watching.update(120.0)
            except Rejected as rejected:
                print("rejected:", rejected.reason)
            watching.cancel("seen enough")
            assert watching.wait() is Outcome.KILLED
