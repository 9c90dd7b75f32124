"""A guard of "done" sees the values that were set before the activity ended."""

from tca_behaviours.coordination import Activity, Coordination, Coordinator, Do
from tca_module import Command, Module, Task, Variable
from tca_module.testing import LocalCentral

ASK = Command("ask", bool)
IS_FREE = Variable("is free", bool)
ROUNDS = 60


def asking() -> Coordination:
    """Return a machine that asks in turn for yes and no, until it sees another answer."""
    with Coordination("ask on") as machine:
        yes = machine.state("yes", Activity(Do(ASK, True)))
        no = machine.state("no", Activity(Do(ASK, False)))
        stale = machine.final("stale")
        yes.to(no, when=IS_FREE)
        yes.to(stale)
        no.to(stale, when=IS_FREE)
        no.to(yes)
        no.to(machine.final("enough"), on="enough")
        yes.to(machine.final("enough too"), on="enough")
    return machine


def test_guard_sees_a_value_set_before_the_end() -> None:
    """The clock is real, so the value and the end of the task arrive in any order."""
    robot, answers = Module("robot"), list[bool]()
    coordinator = Coordinator(asking())
    coordinator.handle_in(robot)

    @robot.handles(ASK, resource="person")
    def ask(task: Task, answer: bool) -> None:
        task.set_variable(IS_FREE, answer)
        answers.append(answer)
        if len(answers) == ROUNDS:
            coordinator.post("enough")
            task.sleep(60)  # the machine leaves its state, and kills the task

    with LocalCentral() as central:
        robot.central = central
        with robot.running():
            assert coordinator.run(robot).state != "stale"
    assert len(answers) == ROUNDS
