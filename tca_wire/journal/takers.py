"""Functions by the type of what they take. Pure."""

from collections.abc import Callable
from inspect import isfunction, signature
from types import ModuleType
from typing import Any, get_type_hints


def takers(
    *parts: type | ModuleType, parameter: str = "fact"
) -> dict[type, Callable[[Any, Any], None]]:
    """By type, the method of some classes, or the function of some modules, that takes it: each of
    which the second and last parameter is called so takes all of the type that it names.
    """
    return {
        get_type_hints(take)[parameter]: take
        for part in parts
        for take in vars(part).values()
        if isfunction(take) and [*signature(take).parameters][1:] == [parameter]
    }
