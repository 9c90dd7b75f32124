"""Queries: wait for one reply, collect replies later, or ask every module that handles a query."""

from dataclasses import dataclass

from tca_module import Module, MultiQuery, Query, Task


@dataclass
class Place:
    x: float
    y: float


HEIGHT = Query("height", Place, reply=float)
BATTERY = MultiQuery("battery", reply=float)

hills, asker = Module("hills"), Module("asker")
left, right = Module("left arm"), Module("right arm")


@hills.handles(HEIGHT)
def height(_: Task, place: Place) -> float:
    return place.x * 0.1 + place.y * 0.2


@left.handles(BATTERY)
def battery_of_left(_: Task) -> float:
    return 0.9


@right.handles(BATTERY)
def battery_of_right(_: Task) -> float:
    return 0.4


if __name__ == "__main__":
    with hills.running(), left.running(), right.running(), asker.running():
        print("height:", asker.query(HEIGHT, Place(1.0, 2.0)))
        pending = [asker.query_send(HEIGHT, Place(float(x), 0.0)) for x in range(3)]
        print("heights:", [reply.receive(timeout=5) for reply in pending])
        print("lowest battery:", min(asker.multi_query(BATTERY, timeout=5)))
