"""Checks the annotations of a handler against the types that its message declares."""

import inspect
from collections.abc import Callable
from dataclasses import is_dataclass
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

from tca_module.errors import MisuseError
from tca_wire.messages.declarations import Message
from tca_wire.messages.formats import type_name


def check_annotations(name: str, function: Callable[..., Any], message: Message[Any, Any]) -> None:
    """Raise MisuseError if a handler's data or result is annotated with a type that never fits.

    An annotation that can't be judged passes, such as a type that is imported for type checkers
    only.
    """
    try:
        called: Any = function if inspect.isroutine(function) else type(function).__call__
        hints, names = get_type_hints(called), [*inspect.signature(function).parameters, ""]
        parameter, returned = names[1], hints.get("return", Any)
        hint = hints.get(parameter, Any)
        is_misfit = all(
            _shape(one) and _shape(wanted) and _shape(one) != _shape(wanted)
            for one in _members(returned)
            for wanted in _members(message.reply.kind)
        )
    except Exception:  # noqa: BLE001 - annotations may be anything, and need not be there
        return
    if parameter == "task" and names[0] != "_" and names[0] not in hints:
        raise MisuseError(
            f"{name} takes '{names[0]}' before the task: declare it with (task, data)"
        )
    if is_misfit:
        raise MisuseError(
            f"{name} returns {type_name(returned)}, but {message.title} has a"
            f" {'result' if message.message_class.is_task else 'reply'} of type {message.reply}:"
            " return and annotate that"
        )
    if message.data.kind is not type(None) and not _may_be(message.data.kind, hint):
        raise MisuseError(
            f"{name} takes {parameter}: {type_name(hint)}, but {message.title} has data of type"
            f" {message.data}: annotate {parameter} with that"
        )


_SHAPES = {type(None): 1, str: 2, bool: 3, int: 3, float: 3, list: 4, tuple: 4, dict: 4}


def _shape(kind: Any) -> int:
    """Return a number for types whose values look alike when they are sent; 0 in case of doubt."""
    return 4 if is_dataclass(kind) else _SHAPES.get(get_origin(kind) or kind, 0)


def _may_be(kind: Any, hint: Any) -> bool:
    """Return whether values of type *kind* may also be of type *hint*; True in case of doubt."""
    return all(any(_is_like(one, other) for other in _members(hint)) for one in _members(kind))


def _members(kind: Any) -> tuple[Any, ...]:
    """Return the types of a union, without the metadata of Annotated."""
    if get_origin(kind) is Annotated:
        return _members(get_args(kind)[0])
    return get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)


def _is_like(kind: Any, hint: Any) -> bool:
    """Do the same as ``_may_be`` for types that are no unions."""
    if kind == hint or Any in (kind, hint):
        return True
    inner, wanted = get_args(kind), get_args(hint)
    fits = len(inner) != len(wanted) or all(map(_may_be, inner, wanted))
    return fits and _is_class_of(get_origin(kind) or kind, get_origin(hint) or hint)


def _is_class_of(kind: Any, hint: Any) -> bool:
    if not (isinstance(kind, type) and isinstance(hint, type)) or inspect.isabstract(kind):
        return True
    try:
        return issubclass(kind, hint) or (
            hint in (float, complex) and issubclass(kind, int | float)
        )
    except TypeError:  # for example, of a Protocol
        return True
