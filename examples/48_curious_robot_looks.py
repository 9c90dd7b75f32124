"""A gaze observes the tasks of others. It looks at the face and at the thing that they name."""

from dataclasses import dataclass
from queue import Queue

from tca_module import Change, Command, Module, Task, TaskFailed, connect
from tca_module.testing import LocalCentral


@dataclass
class Region:
    what: str
    x: float
    y: float


LABEL_QUERY, GRASP = Command("label query", Region, result=str), Command("grasp", Region)
dialog, arm, gaze = Module("dialog"), Module("arm"), Module("gaze")
looked = Queue[str]()


@dialog.handles(LABEL_QUERY, accepts=True)
def ask(task: Task, face: Region) -> str:
    if face.what == "nobody":
        raise task.rejected("nobody is there")
    task.accept()
    return "banana"


@arm.handles(GRASP)
def grasp(task: Task, thing: Region) -> None: ...


@gaze.observes(LABEL_QUERY, states=["running"])  # after the task is accepted
@gaze.observes(GRASP, states=["running"])
def look(change: Change) -> None:
    looked.put(f"looks at {change.goal.what} at {change.goal.x:g}, {change.goal.y:g}")


if __name__ == "__main__":
    with LocalCentral() as central:
        dialog.central = arm.central = gaze.central = central
        with (
            dialog.running(),
            arm.running(),
            gaze.running(),
            connect("initiative", central) as robot,
        ):
            try:
                robot.command(LABEL_QUERY, Region("nobody", 0.0, 0.0)).result(5)
            except TaskFailed as error:
                print(f"{error.failure}: {error.text}")
            name = robot.command(LABEL_QUERY, Region("a face", 0.0, 1.7)).result(5)
            print(looked.get(timeout=5), f"it is a {name}", sep="\n")
            robot.command(GRASP, Region("a thing", 0.4, 0.1)).wait(5)
            print(looked.get(timeout=5))
