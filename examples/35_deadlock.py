"""Two handlers that ask each other would wait for ever: the second one is told at once, with the
circle.

::

    $ python examples/35_deadlock.py
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
    except Deadlock as deadlock:  # let pass, it would be the failure "deadlock"
        circle = deadlock.text.partition(": ")[2]
        print("eyes:", circle.replace("; ", ";\n      "))
        return "seen without a map"


if __name__ == "__main__":
    with LocalCentral() as central:
        world.central = eyes.central = central
        with world.running(), eyes.running(), connect("user", central) as user:
            print("map:", user.query(WHERE))
