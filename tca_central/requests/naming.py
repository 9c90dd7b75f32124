"""Finds the ids of tasks that a module names by the requests that sent them.

Until a sender learns the id of its new task, it names the request: -7 is the task of request 7.
"""

from collections.abc import Callable, Iterator
from operator import attrgetter
from typing import Any, get_type_hints

import msgspec

from tca_central.errors import RequestError
from tca_central.model.deliveries import Connection
from tca_wire.constraints import Constraint
from tca_wire.packets import headers
from tca_wire.packets.headers import ToCentral
from tca_wire.packets.parts import WatchOptions
from tca_wire.points import THIS, Point, TaskId
from tca_wire.vocabulary import Refusal


def with_ids(connection: Connection, header: Any) -> Any:
    """Return *header* with the ids of all tasks in it. Raise RequestError if one is unknown."""
    changes = {}
    kind = type(header)
    if not any(_READERS[kind](header)):
        return header
    for field, resolve in NAMING[kind]:
        named = getattr(header, field)
        if named and (known := resolve(connection, named)) is not named:
            changes[field] = known
    return msgspec.structs.replace(header, **changes) if changes else header


def refuse_lost(lost: list[tuple[int, int]], header: Any) -> None:
    """Raise RequestError if a header names a task that the disk may have lost."""
    for field, _ in NAMING[type(header)]:
        for task in _named(getattr(header, field)):
            if any(first <= task <= last for first, last in lost):
                text = (
                    f"task {{{task}}} is lost: it was not on the disk, or left out, when central "
                    "was restarted; send it again"
                )
                raise RequestError(Refusal.UNKNOWN, text)


def _named(value: Any) -> Iterator[int]:
    """Yield the tasks that a field names."""
    if isinstance(value, int):
        yield value
    elif isinstance(value, Point):
        yield value.task
    elif isinstance(value, WatchOptions):
        yield from _named(value.until)
    for constraint in value if isinstance(value, list) else ():
        yield from (constraint.before.task, constraint.after.task)


def _task(connection: Connection, task: TaskId) -> TaskId:
    """Return the id of a task that is named by its id or its request."""
    if task >= THIS:
        return task
    known = connection.tasks.get(-task)
    if known is None:
        text = (
            f"there is no task of request {-task}: it was refused, "
            "or 128 others have been sent since"
        )
        raise RequestError(Refusal.UNKNOWN, text)
    return known


def _point(connection: Connection, point: Point) -> Point:
    """Return a point with the id of its task."""
    return point if point.task >= THIS else Point(_task(connection, point.task), point.moment)


def _constraints(connection: Connection, constraints: list[Constraint]) -> list[Constraint]:
    """Return constraints with the ids of their tasks; the same list if all are ids already."""
    if all(one.before.task >= THIS and one.after.task >= THIS for one in constraints):
        return constraints
    return [
        Constraint(_point(connection, one.before), _point(connection, one.after), one.delay)
        for one in constraints
    ]


def _watch(connection: Connection, watch: WatchOptions) -> WatchOptions:
    """Return a monitor's options with the id of the task of its end point."""
    until = _point(connection, watch.until) if watch.until is not None else None
    return watch if until is watch.until else msgspec.structs.replace(watch, until=until)


_RESOLVERS: dict[Any, Callable[[Connection, Any], Any]] = {
    TaskId: _task,
    Point: _point,
    Point | None: _point,
    list[Constraint]: _constraints,
    WatchOptions | None: _watch,
}


def _naming(header: type) -> tuple[tuple[str, Callable[[Connection, Any], Any]], ...]:
    """Return the fields of a class of headers that name tasks, each with its resolver."""
    fields = get_type_hints(header).items()
    found = tuple((name, _RESOLVERS[hint]) for name, hint in fields if hint in _RESOLVERS)
    # ``on_kill`` finds the task itself: it accepts the kill of a task that was never created.
    return found if header is not headers.Kill else tuple(one for one in found if one[0] != "task")


def _reader(fields: list[str]) -> Callable[[Any], tuple[Any, ...]]:
    """Return a function that reads fields of a header."""
    if len(fields) > 1:
        return attrgetter(*fields)  # for a single name it returns no tuple
    return lambda header: tuple(getattr(header, field) for field in fields)


NAMING = {header: _naming(header) for header in ToCentral.__args__}
"""By class of header: the fields that name tasks, each with its resolver."""

_READERS = {header: _reader([field for field, _ in fields]) for header, fields in NAMING.items()}
"""By class of header: the function that reads all these fields at once, for speed."""
