"""Know the rooms, and the ways between them."""

from courier.messages import NO_ROUTE, ROUTE, Trip
from tca_module import Module, Task

ROOMS = ("office", "hall", "kitchen", "store")
mapper = Module("map")


@mapper.handles(ROUTE)
def find_route(_: Task, trip: Trip) -> list[str]:
    if not {trip.start, trip.end} <= set(ROOMS):
        raise NO_ROUTE(trip)
    start, end = ROOMS.index(trip.start), ROOMS.index(trip.end)
    step = 1 if start < end else -1
    return list(ROOMS[start + step : end : step]) + [trip.end] * (start != end)


if __name__ == "__main__":
    mapper.run()
