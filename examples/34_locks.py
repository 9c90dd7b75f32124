"""A scanner locks the controller of the body, so that moves wait until the scan is done."""

from tca_module import Command, Module, Task, connect

SCAN = Command("scan", result=str, progress=str)
MOVE = Command("move", int)

scanner, controller = Module("scanner"), Module("controller")


@scanner.handles(SCAN)
def scan(task: Task) -> str:
    # Waits for a running move. No other move starts before the end of the block.
    with task.lock("controller", timeout=5.0):
        print("scan")
        task.report("locked")
        task.sleep(0.2)
        print("scanned")
    return "a map"


@controller.handles(MOVE)
def move(_: Task, number: int) -> None:
    print(f"move {number}")


if __name__ == "__main__":
    with scanner.running(), controller.running(), connect("user") as user:
        scanning = user.command(SCAN)
        next(scanning.progress(str, timeout=10))  # the scan has the lock
        moving = user.command(MOVE, 1, sequential=False)  # waits in the controller's queue
        moving.result(timeout=10)
        print("result:", scanning.result(timeout=10))
