"""Update and cancel a running task: the camera accepts a new goal, rejects one, then is cancelled.

Output::

    looks at 10.0
    looks at 30.0
    rejected: it turns by 90 degrees at most
    the shutter is closed
    killed cancelled seen enough (by user)
"""

from tca_module import Command, Module, Rejected, Task, connect
from tca_module.testing import LocalCentral

WATCH = Command("watch", float, progress=float)  # the wanted and the reached angle

camera = Module("camera")


@camera.handles(WATCH, takes=["update", "cancel"])
def watch(task: Task, angle: float) -> None:
    task.report(angle)
    for request in task.requests():
        if request.transition == "cancel":
            print("the shutter is closed")
            raise task.aborted()
        if abs(request.goal) > 90:
            request.reject("it turns by 90 degrees at most")
        else:
            request.accept()
            task.report(request.goal)


if __name__ == "__main__":
    with LocalCentral() as central:
        camera.central = central
        with camera.running(), connect("user", central) as user:
            watching = user.command(WATCH, 10.0)
            angles = watching.progress(float)
            print("looks at", next(angles))
            watching.update(30.0)
            print("looks at", next(angles))
            try:
                watching.update(120.0)
            except Rejected as rejected:
                print("rejected:", rejected.reason)
            changes = watching.changes()
            watching.cancel("seen enough")
            print(watching.wait(), watching.state, list(changes)[-1].text)
