"""The tasks that servers offer.

For central, each task is a command. A mark in the format of the data distinguishes these commands
from others.
"""

import inspect
import json
import keyword
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Literal, Union

import msgspec

from tca_behaviours.missions.client.errors import BadParameter
from tca_behaviours.missions.outcomes import TaskEnd
from tca_module.sending.directory import MessageInfo
from tca_wire.errors import BadData
from tca_wire.messages.formats import MISSION_TASK
from tca_wire.text.nearest import nearest_or_all
from tca_wire.text.plain_data import FieldMisfit, PlainFormat

_TYPES: dict[str, Any] = {
    "number": float,
    "integer": int,
    "boolean": bool,
    "string": str,
    "null": None,
}
_BOUNDS = {
    "minimum": ">= {}",
    "exclusiveMinimum": "> {}",
    "maximum": "<= {}",
    "exclusiveMaximum": "< {}",
}


class _TaskMark(msgspec.Struct, frozen=True):
    server: str
    task: str
    help: str = ""
    periodic: bool = True
    parameters: tuple[str, ...] = ()  # in the order of declaration
    idle: bool = False


class TaskParameter:
    """A parameter of an offered task."""

    def __init__(
        self,
        name: str,
        schema: Mapping[str, Any],
        definitions: Mapping[str, Any],
        *,
        required: bool,
    ) -> None:
        self.name = name
        self.type = _type_of(schema, definitions)
        self.default = inspect.Parameter.empty if required else schema.get("default")
        self.description = str(schema.get("description", ""))
        self.bounds = ", ".join(
            words.format(schema[key]) for key, words in _BOUNDS.items() if key in schema
        )

    @property
    def help_text(self) -> str:
        """One line of help: name, type, default, bounds and description."""
        default = "" if self.default is inspect.Parameter.empty else f" = {self.default!r}"
        bounds = f" ({self.bounds})" if self.bounds else ""
        return f"{self.name}: {inspect.formatannotation(self.type)}{default}{bounds}" + (
            f"  {self.description}" if self.description else ""
        )


class OfferedTask:
    """A task that a server offers."""

    def __init__(self, info: MessageInfo, mark: _TaskMark, schema: Mapping[str, Any]) -> None:
        self.message = info.name
        self.server = mark.server
        self.name = mark.task
        self.help = mark.help
        self.is_periodic = mark.periodic
        self.is_idle = mark.idle  #: whether the server runs it while nothing has the foreground
        self.is_handled = any(handler.capacity for handler in info.handled_by)
        self._format = PlainFormat(info.data)
        definitions = schema.get("$defs", {})
        struct = _resolved(schema, definitions)
        self.required: Sequence[str] = struct.get("required", ())
        properties = struct.get("properties", {})
        declared = [name for name in mark.parameters if name in properties]
        self.parameters = [
            TaskParameter(name, properties[name], definitions, required=name in self.required)
            for name in dict.fromkeys([*declared, *properties])
        ]

    @property
    def runs_in_foreground(self) -> bool:
        """Whether a call without ``foreground=`` runs in the foreground."""
        return all(
            parameter.default is not False
            for parameter in self.parameters
            if parameter.name == "foreground"
        )

    @property
    def signature(self) -> inspect.Signature:
        """The signature of the mission's function for the task: all parameters are keyword-only."""
        kind = inspect.Parameter.KEYWORD_ONLY
        return inspect.Signature(
            [
                inspect.Parameter(
                    parameter.name, kind, default=parameter.default, annotation=parameter.type
                )
                for parameter in self.parameters
                if is_identifier(parameter.name)
            ],
            return_annotation=TaskEnd,
        )

    @property
    def help_text(self) -> str:
        """The task's help text, then a line for each parameter."""
        return "\n".join(
            [
                self.help or f"Task {self.name} of {self.server}.",
                "",
                *(p.help_text for p in self.parameters),
            ]
        )

    def validate(self, parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Check the given parameters, and return them as they are sent. Raises BadParameter."""
        names = [parameter.name for parameter in self.parameters]
        for name in parameters:
            if name not in names:
                known = nearest_or_all(name, names, "it has")
                raise BadParameter(f"{self.name}() has no parameter '{name}': {known}")
        try:
            plain: dict[str, Any] = msgspec.to_builtins(dict(parameters), enc_hook=_to_plain)
            for name, value in plain.items():
                _check_finite(name, value)
            self._format.encode(plain)
        except FieldMisfit as error:
            raise BadParameter(f"{self.name}(): parameter '{error.path}' {error.problem}") from None
        except (BadData, TypeError, ValueError, RecursionError) as error:
            raise BadParameter(f"{self.name}(): {error}") from None
        return plain


def is_identifier(text: str) -> bool:
    """Return whether *text* can be a name in Python."""
    return text.isidentifier() and not keyword.iskeyword(text)


def offered_tasks(messages: Iterable[MessageInfo]) -> Iterator[OfferedTask]:
    """Yield the tasks of missions among the messages that central knows."""
    for info in messages:
        if MISSION_TASK not in info.data:
            continue
        try:
            schema = json.loads(info.data)
            mark = msgspec.convert(schema[MISSION_TASK], _TaskMark)
        except (ValueError, KeyError, TypeError, RecursionError, msgspec.ValidationError):
            continue  # any module may declare a format: skip a malformed mark
        yield OfferedTask(info, mark, PlainFormat(info.data).shape)


def _resolved(schema: Mapping[str, Any], definitions: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the definition that a schema refers to; the schema itself if it is no reference."""
    return (
        definitions.get(str(schema["$ref"]).rpartition("/")[2], {}) if "$ref" in schema else schema
    )


def _type_of(schema: Mapping[str, Any], definitions: Mapping[str, Any], depth: int = 0) -> Any:
    """Return the Python type for a JSON Schema, for signatures."""
    schema = _resolved(schema, definitions)
    if depth > 9:  # references may form a cycle
        return Any
    if "enum" in schema:
        return Literal[tuple(schema["enum"])]
    if "anyOf" in schema:
        types = tuple(_type_of(choice, definitions, depth + 1) for choice in schema["anyOf"])
        return Union[types]  # noqa: UP007 - only Union takes a tuple
    if schema.get("type") == "array":
        element = _type_of(schema.get("items", {}), definitions, depth + 1)
        return list[element]  # type: ignore[valid-type]
    if schema.get("type") == "object":
        return dict[str, Any]
    return _TYPES.get(str(schema.get("type")), Any)


def _check_finite(name: str, value: Any) -> None:
    """Raise FieldMisfit if a number is infinite or NaN, also inside a list or mapping."""
    if isinstance(value, float) and not math.isfinite(value):
        raise FieldMisfit(name, f"must be finite, not {value}")
    if isinstance(value, dict | list | tuple):
        for part in value.values() if isinstance(value, dict) else value:
            _check_finite(name, part)


def _to_plain(value: Any) -> Any:
    """Convert a number or an array of numpy to plain values."""
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"objects of type {type(value).__name__} can't be sent")
