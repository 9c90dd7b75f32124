"""The names in a model, which become names in Python."""

import builtins
import keyword
import re

from tca_behaviours.activities.components import Component
from tca_behaviours.activities.models.methods import GUARD, STEP, methods
from tca_behaviours.activities.models.model import ComponentModel
from tca_tools.errors import BadUserFile

_NAME = re.compile(r"[a-z][a-z0-9_]{0,39}")
_CLASS = re.compile(r"[A-Z][A-Za-z0-9]{0,39}")
_COMPONENT_ATTRIBUTES = {
    name for name in {*dir(Component), *vars(Component("", dict))} if not name.startswith("__")
}
FILES = ("generated", "application")
"""The modules that are overwritten each time."""
_RESERVED_CLASSES = {"ABC", "Any", "Callable", "Component", "Components", "Event", *dir(builtins)}


def check_name(place: str, name: str) -> None:
    """Raise BadUserFile unless an attribute, variable or method may have this name."""
    if not _NAME.fullmatch(name) or keyword.iskeyword(name):
        raise BadUserFile(
            f"{place}: '{name}' can't be a name: use small letters, digits and '_', "
            "and no keyword of Python"
        )


def check_class(place: str, name: str) -> None:
    """Raise BadUserFile unless a type or component may have this name."""
    if not _CLASS.fullmatch(name) or name in _RESERVED_CLASSES:
        raise BadUserFile(
            f"{place}: '{name}' can't be a class: use letters and digits, a capital first, "
            "and no built-in name of Python"
        )


def check_attributes(place: str, component: ComponentModel) -> None:
    """Raise BadUserFile if a name of a component stands for two things."""
    named = [(name, "an input port", f"inputs.{name}") for name in component.inputs]
    named += [(name, "an output port", f"outputs.{name}") for name in component.outputs]
    named += [(name, "a region", f"regions.{name}") for name in component.regions]
    named += [(method.name, method.role, method.place) for method in methods(component)]
    used = dict.fromkeys(_COMPONENT_ATTRIBUTES, "part of every component")
    for name, role, where in named:
        check_name(f"{place}.{where}", name)
        is_shared = role in (STEP, GUARD)  # several states may use one method
        if name in used and not (is_shared and used[name] == role):
            raise BadUserFile(
                f"{place}.{where}: '{name}' is {used[name]} already: choose another name"
            )
        used[name] = role


def file_of(component: str) -> str:
    """Return the module in which the user writes a component."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", component).lower()
