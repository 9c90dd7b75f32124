"""Handle a failure: to catch or print it changes nothing, to retry the task deals with it."""

from tca_module import Command, ExceptionHandler, Failure, Goal, Module, Task, TaskFailed, connect

FETCH, GRASP = Goal("fetch"), Command("grasp", float)  # the force
SLIPPED = Failure("slipped", float)
PRINT_IT, HARDER = ExceptionHandler("print it", float), ExceptionHandler("grasp harder", float)

planner, hand, expert = Module("planner"), Module("hand"), Module("expert")


@planner.handles(FETCH)
def fetch(task: Task) -> None:
    try:
        task.command(GRASP, 1.0).result()
    except TaskFailed:
        print("caught")  # does not stop the failure of the grasp


@hand.handles(GRASP)
def grasp(_: Task, force: float) -> None:
    print("grasp with", force)
    if force < 2:
        raise SLIPPED(force, "it is wet")


@expert.handles(PRINT_IT)
def print_it(task: Task, _: float) -> None:
    print("observed:", task.trouble.failure)  # the failure continues up the tree


@expert.handles(HARDER)
def harder(task: Task, force: float) -> None:
    task.trouble.failing.retry(GRASP, force + 1)  # deals with the failure


if __name__ == "__main__":
    with planner.running(), hand.running(), expert.running(), connect("user") as user:
        user.on_failure(SLIPPED, PRINT_IT, of=GRASP)
        try:
            user.goal(FETCH).result(timeout=10)
        except TaskFailed as error:
            print(error)
        user.on_failure(SLIPPED, HARDER, of=GRASP)
        print("fetch is", user.goal(FETCH).wait(timeout=10))
