"""Parameters of tasks: declared as attributes of the task's class, and sent as one struct."""

import inspect
import json
from collections.abc import Iterable, Mapping
from typing import Annotated, Any, ClassVar, TypeVar, get_origin, get_type_hints, overload

import msgspec

from tca_module import BadData, BadFormat
from tca_wire.messages.formats import Format

T = TypeVar("T")

MARKER = "x-tca-mission"
"""The key of a schema by which missions find the tasks among all messages."""


class Parameter:
    """The declaration of a parameter: its default (NODEFAULT: it must be given) and what may be said of its type."""

    def __init__(self, default: Any, meta: msgspec.Meta) -> None:
        self.default = default
        self.meta = meta


@overload
def parameter(
    default: T, description: str = "", *, minimum: float | None = None, maximum: float | None = None
) -> T: ...
@overload
def parameter(*, description: str = "", minimum: float | None = None, maximum: float | None = None) -> Any: ...
def parameter(
    default: Any = msgspec.NODEFAULT, description: str = "", *, minimum: float | None = None,
    maximum: float | None = None,
) -> Any:  # fmt: skip
    """Declare a parameter of a task; without a default it must be given.

    ::

        goal_x: float = parameter(0.0, "X coordinate of destination", minimum=0, maximum=11)
    """
    return Parameter(default, msgspec.Meta(description=description or None, ge=minimum, le=maximum))


def fields_of(task: type, base: type, common: Iterable[str]) -> dict[str, tuple[Any, Any]]:
    """The parameters of a task's class, by name: type and default. What *base* has itself is none, but for those that
    are *common* to all tasks. Raises BadFormat if one can't be.
    """
    given = {name for one in base.__mro__ for name in vars(one).get("__annotations__", {})} - set(common)
    fields = {}
    for name, hint in _hints(task).items():
        if name.startswith("_") or get_origin(hint) is ClassVar or name in given:
            continue
        if name not in common and hasattr(base, name):
            raise BadFormat(f"task {task.__name__}: parameter '{name}' has the name of something that every task has")
        fields[name] = _field(task, name, hint)
    for name in given & vars(task).keys():
        raise BadFormat(f"task {task.__name__}: '{name}' is given by the server: choose another name")
    return fields


def _hints(task: type) -> dict[str, Any]:
    try:
        return get_type_hints(task, include_extras=True)
    except (NameError, TypeError, SyntaxError) as error:
        raise BadFormat(f"task {task.__name__}: the types of its parameters can't be read: {error}") from None


def _field(task: type, name: str, hint: Any) -> tuple[Any, Any]:
    """Type and default of a parameter; a class that inherits it may give it another default only."""
    given = [vars(one)[name] for one in task.__mro__ if name in vars(one)]
    declared = next((one for one in given if isinstance(one, Parameter)), None)
    if declared is not None:
        hint = Annotated[hint, declared.meta]
    default = given[0] if given else msgspec.NODEFAULT
    default = default.default if isinstance(default, Parameter) else default
    try:
        kind = Format[Any](hint)
        if default is not msgspec.NODEFAULT:
            kind.encode(default)
    except BadFormat as error:
        raise BadFormat(f"task {task.__name__}: parameter '{name}' can't be sent: {error}") from None
    except BadData as error:
        raise BadFormat(f"task {task.__name__}: the default of parameter '{name}' does not fit: {error}") from None
    return hint, default


def struct_of(task: type, fields: Mapping[str, tuple[Any, Any]]) -> type[msgspec.Struct]:
    """The type of the data that are sent to start a task."""
    rows: list[Any] = [
        (name, hint) if default is msgspec.NODEFAULT else (name, hint, default)
        for name, (hint, default) in fields.items()
    ]
    namespace = {"__doc__": help_of(task)}
    try:
        return msgspec.defstruct(
            task.__name__, rows, namespace=namespace, kw_only=True, forbid_unknown_fields=True, module=task.__module__
        )
    except (TypeError, ValueError) as error:
        raise BadFormat(f"task {task.__name__}: its parameters can't be sent: {error}") from None


def help_of(task: type) -> str:
    """The help text of a task: the docstring of its class."""
    return inspect.cleandoc(task.__doc__ or "")


class TaskFormat(Format[Any]):
    """The format of a task's parameters, with a marker for missions."""

    def __init__(self, kind: type[msgspec.Struct], marker: Mapping[str, Any]) -> None:
        super().__init__(kind)
        schema = json.loads(self.schema) | {MARKER: dict(marker)}
        self.schema = json.dumps(schema, sort_keys=True, separators=(",", ":"))
