"""Follow a task: its intermediate results, and the changes of its state."""

from tca_module import Command, Module, Task, connect

DIG = Command("dig", int, result=str, progress=int)

arm = Module("arm")


@arm.handles(DIG)
def dig(task: Task, depth: int) -> str:
    for reached in range(10, depth + 1, 10):
        task.sleep(0.05)
        task.report(reached)
    return "clay"


if __name__ == "__main__":
    with arm.running(), connect("user") as user:
        digging = user.command(DIG, 30, suspended=True)  # starts after resume()
        depths, changes = digging.progress(int), digging.changes()
        digging.resume()
        for depth in depths:  # ends with the task
            print(f"{depth} cm")
        for change in changes:  # the server is the module that handles the task
            print(f"{change.transition} by {change.by}: {change.state}")
        print("found", digging.result())
