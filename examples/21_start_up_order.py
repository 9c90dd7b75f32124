"""Start programs in any order: one waits for messages it requires, one watches joins and leaves."""

import threading

from tca_module import (
    HANDLERS_CHANGED,
    MODULE_LEFT,
    Departure,
    HandlerCount,
    Module,
    Query,
    Task,
    connect,
)

WHERE, ROUTE = Query("where", reply=int), Query("route", int, reply=int)

map_, guard = Module("map"), Module("guard")
planner = Module("planner", requires=[WHERE])
is_over = threading.Event()


@map_.handles(WHERE)
def where(_: Task) -> int:
    return 7


@planner.handles(ROUTE)
def route(task: Task, goal: int) -> int:
    return goal - task.query(WHERE)


@guard.handles(HANDLERS_CHANGED)
def on_change(_: Task, change: HandlerCount) -> None:
    print(f"'{change.message}' is handled by {change.handlers}")
    if change.message == "route" and not change.handlers:
        is_over.set()


@guard.handles(MODULE_LEFT)
def on_leave(_: Task, departure: Departure) -> None:
    if departure.module == "map":
        print(f"{departure.module} left: {departure.why}")


if __name__ == "__main__":
    with connect("user") as user, guard.running():
        starting = threading.Thread(target=planner.run)  # waits for a handler of 'where'
        starting.start()
        print("asked too early:", user.execute_if_handled(ROUTE, 10))
        with map_.running():
            user.wait_until_handled(ROUTE, timeout=10)
            print("route:", user.query(ROUTE, 10), "by", user.handlers(ROUTE)[0].module)
        planner.stop()
        starting.join()
        is_over.wait(10)
