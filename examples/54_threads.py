"""Threads of a pool share one client.

Output::

    sum: 190
    modules: ['scale', 'user']
    move: arm is in place 3
"""

from concurrent.futures import ThreadPoolExecutor

from tca_module import Command, Module, Query, Task, connect

WEIGHT = Query("weight", int, reply=int)
MOVE = Command("move", int, result=str)

scale = Module("scale", capacity=4)


@scale.handles(WEIGHT)
def weight(_: Task, item: int) -> int:
    return item


@scale.handles(MOVE, resource="arm")
def move(_: Task, place: int) -> str:
    return f"arm is in place {place}"


if __name__ == "__main__":
    with (
        scale.running(),
        connect("user", threads=True) as user,
        ThreadPoolExecutor(20) as pool,
    ):
        # Each thread opens a connection of its own at its first call. Central sees one module.
        print("sum:", sum(pool.map(lambda item: user.query(WEIGHT, item), range(20))))
        print("modules:", [module.name for module in user.modules()])

        # A task belongs to the thread that sent it, so that thread waits for it.
        print("move:", pool.submit(lambda: user.command(MOVE, 3).result(timeout=5)).result())
