"""Programs that start in any order: one waits for what it requires, one is told who comes and
goes.
"""

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
map_is_gone = threading.Event()


@map_.handles(WHERE)
def where(_: Task) -> int:
    return 7


@planner.handles(ROUTE)
def route(task: Task, goal: int) -> int:
    return goal - task.query(WHERE)


@guard.handles(HANDLERS_CHANGED)
def on_change(_: Task, change: HandlerCount) -> None:
    print(f"'{change.message}' is handled by {change.handlers}")


@guard.handles(MODULE_LEFT)
def on_leave(_: Task, who: Departure) -> None:
    if who.module == "map":
        print(f"{who.module} left: {who.why}")
        map_is_gone.set()


if __name__ == "__main__":
    with connect("user") as user, guard.running():
        starting = threading.Thread(target=planner.run)  # it waits: nobody handles 'where' yet
        starting.start()
        print("asked too early:", user.execute_if_handled(ROUTE, 10))
        with map_.running():
            user.wait_until_handled(ROUTE, timeout=10)
            print("route:", user.query(ROUTE, 10), "by", user.handlers(ROUTE)[0].module)
        map_is_gone.wait(10)
        planner.stop()
        starting.join()
