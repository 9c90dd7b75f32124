"""Tables of functions by the type of their argument."""

from collections.abc import Callable
from inspect import isfunction, signature
from types import ModuleType
from typing import Any, get_type_hints


def takers(
    *parts: type | ModuleType, parameter: str = "fact"
) -> dict[type, Callable[[Any, Any], None]]:
    """Map types to the methods of classes, or functions of modules, that accept them.

    A function counts if its second and last parameter has the name *parameter*; the type is that
    parameter's annotation.
    """
    return {
        get_type_hints(function)[parameter]: function
        for part in parts
        for function in vars(part).values()
        if isfunction(function) and [*signature(function).parameters][1:] == [parameter]
    }
