"""Two handlers that query each other would deadlock. The second query raises ``Deadlock`` at once.

The error has the cycle of waits. Output::

    eyes: where {1} in map waits for the reply to look {2};
          look {2} in eyes waits for the reply to where {3};
          where {3} waits for map, busy with where {1}
    map: seen without a map
"""

from tca_module import Deadlock, Module, Query, Task, connect
from tca_module.testing import LocalCentral

WHERE, LOOK = Query("where", reply=str), Query("look", reply=str)

world, eyes = Module("map"), Module("eyes")


@world.handles(WHERE)
def where(task: Task) -> str:
    return task.query(LOOK)


@eyes.handles(LOOK)
def look(task: Task) -> str:
    try:
        return "seen with a map: " + task.query(WHERE)
    except Deadlock as deadlock:  # uncaught, it fails this query with "deadlock"
        cycle = deadlock.text.partition(": ")[2]
        print("eyes:", cycle.replace("; ", ";\n      "))
        return "seen without a map"


if __name__ == "__main__":
    with LocalCentral() as central:
        world.central = eyes.central = central
        with world.running(), eyes.running(), connect("user", central) as user:
            print("map:", user.query(WHERE))
