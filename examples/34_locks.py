"""A scanner locks the controller of the body, then reserves it to turn the body itself."""

from tca_module import Command, Module, Task, connect

SCAN = Command("scan", result=str, progress=str)
SCAN_BOTH_SIDES = Command("scan both sides", result=str, progress=str)
TURN_TO = Command("turn to", str)

scanner, controller = Module("scanner"), Module("controller")


@scanner.handles(SCAN)
def scan(task: Task) -> str:
    # A lock: waits for a running turn. No other turn starts before the end of the block.
    with task.lock("controller", timeout=5.0):
        task.report("locked")
        print("scan")
        task.sleep(0.2)
        print("scanned")
    return "a map"


@scanner.handles(SCAN_BOTH_SIDES)
def scan_both_sides(task: Task) -> str:
    # A reservation: as a lock, but the controller still handles what this module sends.
    with task.reserve("controller", timeout=5.0):
        task.report("reserved")
        for side in ("left", "right"):
            task.command(TURN_TO, side).result()
            print("scan the", side)
    return "two maps"


@controller.handles(TURN_TO)
def turn_to(_: Task, side: str) -> None:
    print("turn to the", side)


if __name__ == "__main__":
    with scanner.running(), controller.running(), connect("user") as user:
        for message in (SCAN, SCAN_BOTH_SIDES):
            scanning = user.command(message)
            next(scanning.progress(str, timeout=10))  # the scanner has the controller
            turning = user.command(TURN_TO, "door", sequential=False)  # waits in its queue
            turning.result(timeout=10)
            print("result:", scanning.result(timeout=10))
