"""Return a value: the result of a command, the reply of a query, and how a failure arrives."""

from tca_module import Command, Failure, Module, Query, QueryFailed, Task, TaskFailed, connect

WEIGH = Command("weigh", str, result=float)
WHERE = Query("where", str, reply=str)
UNKNOWN = Failure("unknown thing", str)

robot = Module("robot")
WEIGHTS, PLACES = {"cup": 0.3}, {"cup": "kitchen"}


@robot.handles(WEIGH)
def weigh(_: Task, thing: str) -> float:
    if thing not in WEIGHTS:
        raise UNKNOWN(thing, f"there is no {thing}")
    return WEIGHTS[thing]


@robot.handles(WHERE)
def where(_: Task, thing: str) -> str:
    if thing not in PLACES:
        raise UNKNOWN(thing, f"there is no {thing}")
    return PLACES[thing]


if __name__ == "__main__":
    with robot.running(), connect("user") as user:
        print("result:", user.command(WEIGH, "cup").result(timeout=10))
        print("outcome:", user.command(WEIGH, "piano").wait(timeout=10))
        try:
            user.command(WEIGH, "piano").result(timeout=10)
        except TaskFailed as error:
            print(f"{error.failure}: {error.data_as(UNKNOWN)}")
        print("reply:", user.query(WHERE, "cup", timeout=5))
        try:
            user.query(WHERE, "piano", timeout=5)
        except QueryFailed as error:
            print(error)
