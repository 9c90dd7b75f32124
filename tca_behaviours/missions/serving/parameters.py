"""Parameters of tasks: declared as attributes of the task's class, and sent as one struct."""

import inspect
import json
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import (
    Annotated,
    Any,
    ClassVar,
    NamedTuple,
    TypeVar,
    Union,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)

import msgspec

from tca_module import BadData, BadFormat
from tca_wire.messages.formats import MISSION_TASK, Format
from tca_wire.messages.large_data import inline

T = TypeVar("T")

_NO_DEFAULT: Any = msgspec.NODEFAULT  # typed as Any: it stands for a default of any type
FIXED = "x-tca-fixed"
"""The key in the schema of a parameter that can't be changed while the task runs."""


class Parameter(NamedTuple):
    """The declaration of a parameter: its default, and constraints of its type.

    The default NODEFAULT means that the parameter must be given.
    """

    default: Any
    meta: msgspec.Meta


def parameter(
    default: T = _NO_DEFAULT,
    description: str = "",
    *,
    minimum: float | None = None,
    maximum: float | None = None,
    fixed: bool = False,
) -> T:
    """Declare a parameter of a task.

    Args:
        default: the value if none is given; without it the parameter must be given.
        description: a text for the task's help; name the unit in it.
        minimum: the least value.
        maximum: the greatest value.
        fixed: whether it can't be changed while the task runs. Default: False.

    Returns:
        The declaration, to assign to an annotated attribute of the task's class.

    Example::

        goal_x: float = parameter(0.0, "X coordinate of destination", minimum=0, maximum=11)
    """
    extra = {FIXED: True} if fixed else None
    meta = msgspec.Meta(
        description=description or None, ge=minimum, le=maximum, extra_json_schema=extra
    )
    return cast("T", Parameter(default, meta))


class Field:
    """A parameter of a task: its type, and its default if it has one.

    Raises BadFormat or BadData if the type or the default can't be sent.
    """

    def __init__(self, hint: Any, default: Any) -> None:
        self.hint = hint
        self.is_required = default is msgspec.NODEFAULT
        self.is_fixed = any(
            (meta.extra_json_schema or {}).get(FIXED)
            for meta in get_args(hint)
            if isinstance(meta, msgspec.Meta)
        )
        self._format = Format[Any](hint)
        self._default = b"" if self.is_required else inline(self._format.encode(default))

    @property
    def default(self) -> Any:
        """A new copy of the default, because the task may change a list in place."""
        return self._format.decode(self._default)


def fields_of(
    task: type,
    base: type,
    common: Iterable[str],
    defaults: Mapping[str, Any] = MappingProxyType({}),
) -> dict[str, Field]:
    """Return the parameters of a task's class, by name.

    Attributes of *base* are not parameters, except those that are *common* to all tasks. *defaults*
    has the defaults of parameters for which the class has none. Raises BadFormat if an attribute
    can't be a parameter.
    """
    annotated = {name for cls in base.__mro__ for name in vars(cls).get("__annotations__", {})}
    set_by_server = annotated - set(common)
    fields, hints = {}, _hints(task)
    for name, value in vars(task).items():
        if isinstance(value, Parameter) and name not in hints:
            advice = f"write '{name}: float = parameter(...)'"
            raise BadFormat(f"task {task.__name__}: parameter '{name}' has no type: {advice}")
    for name, hint in hints.items():
        if name.startswith("_") or get_origin(hint) is ClassVar or name in set_by_server:
            continue
        if name not in common and hasattr(base, name):
            raise BadFormat(
                f"task {task.__name__}: parameter '{name}' hides a method or an attribute "
                "of every task: choose another name"
            )
        fields[name] = _field(task, name, hint, defaults.get(name, msgspec.NODEFAULT))
    for name in set_by_server & vars(task).keys():
        raise BadFormat(f"task {task.__name__}: the server sets '{name}': choose another name")
    return fields


def _hints(task: type) -> dict[str, Any]:
    try:
        return get_type_hints(task, include_extras=True)
    except (NameError, TypeError, SyntaxError) as error:
        raise BadFormat(
            f"task {task.__name__}: the types of its parameters can't be read: {error}"
        ) from None


def _field(task: type, name: str, hint: Any, default: Any) -> Field:
    """Make a parameter. If a subclass assigns a plain value, that is only a new default."""
    values = [vars(cls)[name] for cls in task.__mro__ if name in vars(cls)]
    if declared := next((one for one in values if isinstance(one, Parameter)), None):
        hint = Annotated[hint, declared.meta]
    value = values[0] if values else msgspec.NODEFAULT
    if isinstance(value, Parameter):
        value = value.default
    try:
        return Field(hint, default if value is msgspec.NODEFAULT else value)
    except BadFormat as error:
        raise BadFormat(
            f"task {task.__name__}: parameter '{name}' can't be sent: {error}"
        ) from None
    except BadData as error:
        raise BadFormat(
            f"task {task.__name__}: the default of parameter '{name}' does not fit: {error}"
        ) from None


def help_of(task: type) -> str:
    """Return the help text of a task: the docstring of its class."""
    return inspect.cleandoc(task.__doc__ or "")


class TaskFormat(Format[Any]):
    """The format of a task's parameters, with a marker by which missions recognise it.

    A parameter that the sender leaves out is not sent. The server then uses the default. In an
    update of a running task, the parameter keeps its value.
    """

    def __init__(self, task: type, fields: Mapping[str, Field], marker: Mapping[str, Any]) -> None:
        self.fields = fields
        super().__init__(_struct_of(task, fields))
        schema = json.loads(self.schema) | {MISSION_TASK: dict(marker)}
        properties = schema["$defs"][task.__name__]["properties"]
        try:
            for name, default in self.defaults().items():
                properties[name]["default"] = msgspec.to_builtins(default)
        except TypeError as error:
            raise BadFormat(
                f"task {task.__name__}: the default of parameter '{name}' can't be shown: {error}"
            ) from None
        self.schema = json.dumps(schema, sort_keys=True, separators=(",", ":"))

    def defaults(self) -> dict[str, Any]:
        """Return the defaults of the parameters that have one, by name."""
        return {name: field.default for name, field in self.fields.items() if not field.is_required}

    def given_in(self, parameters: msgspec.Struct) -> dict[str, Any]:
        """Return the parameters that the sender has given, by name."""
        values = {name: getattr(parameters, name) for name in self.fields}
        return {name: value for name, value in values.items() if value is not msgspec.UNSET}


def _struct_of(task: type, fields: Mapping[str, Field]) -> type[msgspec.Struct]:
    rows: list[Any] = [
        (name, field.hint)
        if field.is_required
        else (name, Union[field.hint, msgspec.UnsetType], msgspec.UNSET)  # noqa: UP007 - any hint
        for name, field in fields.items()
    ]
    return msgspec.defstruct(
        task.__name__,
        rows,
        namespace={"__doc__": help_of(task)},
        module=task.__module__,
        kw_only=True,
        forbid_unknown_fields=True,
    )
