"""Start programs in any order: one waits for the messages that it requires, one for a handler."""

import threading

from tca_module import Module, Query, Task, connect

WHERE, ROUTE = Query("where", reply=int), Query("route", int, reply=int)

map_, planner = Module("map"), Module("planner", requires=[WHERE])


@map_.handles(WHERE)
def where(_: Task) -> int:
    return 7


@planner.handles(ROUTE)
def route(task: Task, goal: int) -> int:
    return goal - task.query(WHERE)


if __name__ == "__main__":
    with connect("user") as user:
        starting = threading.Thread(target=planner.run)
        starting.start()  # it joins, and waits for a handler of 'where'
        print("handlers of route:", len(user.handlers(ROUTE)))
        with map_.running():
            user.wait_until_handled(ROUTE, timeout=10)
            print("route:", user.query(ROUTE, 10))
        planner.stop()
        starting.join()
