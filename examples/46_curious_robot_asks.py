"""A robot points at a thing and asks for its name. Its dialog has time for one question only."""

import threading

from tca_module import BASIC, Command, Module, Query, Task, TaskFailed, connect
from tca_module.testing import LocalCentral

LABEL_QUERY = Command("label query", str, result=str, life_cycle=BASIC)
POINT, SAY = Command("point", str, life_cycle=BASIC), Command("say", str, life_cycle=BASIC)
LISTEN = Query("listen", reply=str)
dialog, arm, voice, human = Module("dialog"), Module("arm"), Module("voice"), Module("human")
may_answer = threading.Event()
both_started = threading.Barrier(2, timeout=5)


@dialog.handles(LABEL_QUERY, when_busy="reject")
def ask(task: Task, thing: str) -> str:
    with task.parallel():
        pointing, speaking = task.command(POINT, thing), task.command(SAY, "What is that?")
    pointing.result(5)
    speaking.result(5)
    name = task.query(LISTEN)
    with task.parallel():
        task.command(POINT, "home")
        task.command(SAY, f"Ah, a {name}.")
    return name


@arm.handles(POINT)
@voice.handles(SAY)
def act(_task: Task, _target: str) -> None:
    both_started.wait()  # each returns once both have started


@human.handles(LISTEN)
def listen(_: Task) -> str:
    may_answer.wait(5)
    return "banana"


if __name__ == "__main__":
    with LocalCentral() as central:
        for module in (dialog, arm, voice, human):
            module.central = central
        with (
            dialog.running(),
            arm.running(),
            voice.running(),
            human.running(),
            connect("initiative", central) as robot,
        ):
            first = robot.command(LABEL_QUERY, "yellow thing")
            print(f"the first question: {'accepted' if first.next_change(5) else 'is over'}")
            try:
                robot.command(LABEL_QUERY, "red thing", sequential=False).result(5)
            except TaskFailed as error:
                print(f"the second question: {error.failure}, {error.text}")
            may_answer.set()
            print(f"the thing is a {first.result(5)}")
