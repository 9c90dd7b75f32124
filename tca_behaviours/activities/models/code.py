"""The Python code that is generated: data types, bases of components, and the application."""

import json
from collections.abc import Iterable, Iterator
from math import isfinite

from tca_behaviours.activities.models.methods import Method, methods
from tca_behaviours.activities.models.model import (
    ApplicationModel,
    ComponentModel,
    InstanceModel,
    RegionModel,
    StateModel,
)
from tca_behaviours.activities.models.names import file_of
from tca_behaviours.activities.models.statecharts import in_tree_order

MARK = "made by tca generate"
_LONGEST = 88
"""The most characters of a line."""


_BASES = '''"""Data types and bases of components, {mark} from {model}.toml.

Do not change this file: changes would be lost.
"""
# isort: skip_file

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

from tca_behaviours.activities.components import Component
'''


def generated_module(model: ApplicationModel) -> Iterator[str]:
    """Yield the lines of the module of data types and bases."""
    yield from _BASES.format(mark=MARK, model=model.name).splitlines()
    for name, kind in model.types.items():
        if kind.module:
            yield from import_lines(kind.module, [name])
    for name, kind in model.types.items():
        if not kind.module:
            yield from _class("@dataclass(frozen=True)", name, "Data that ports pass.")
            yield from _fields(f"{field}: {type_}" for field, type_ in kind.fields.items())
    for name, component in model.components.items():
        yield from _class("@dataclass", f"{name}Data", f"Data that the activities of {name} share.")
        yield from _fields(
            f"{field}: {type(value).__name__} = {literal(value)}"
            for field, value in component.data.items()
        )
        yield from _base(name, component)


def _class(decorator: str, name: str, about: str) -> Iterator[str]:
    yield from ("", "")
    if decorator:
        yield decorator
    yield f"class {name}:"
    yield f'    """{about}"""'


def _fields(fields: Iterable[str]) -> list[str]:
    lines = [f"    {field}" for field in fields]
    return ["", *lines] if lines else []


def _base(name: str, component: ComponentModel) -> Iterator[str]:
    data = f"{name}Data"
    yield from _class("", f"{name}Base(Component[{data}], ABC)", f"The base of {name}.")
    yield ""
    yield f"    def __init__(self, name: str, data: Callable[[], {data}] = {data}) -> None:"
    yield from statement(
        8, "super().__init__(", ["name", "data", *_times(component.period, component.estimate)]
    )
    for port, input_ in component.inputs.items():
        keep = [f"keep={input_.keep}"] if input_.keep > 1 else []
        arguments = [literal(port), input_.type, f"self.take_{port}", *keep]
        yield from statement(8, f"self.{port} = self.input(", arguments)
    for port, kind in component.outputs.items():
        yield from statement(8, f"self.{port} = self.output(", [literal(port), kind])
    for region, settings in component.regions.items():
        arguments = [literal(region), *_times(settings.period, settings.estimate)]
        yield from statement(8, f"self.{region} = self.region(", arguments)
    for region in component.regions:
        yield f"        self._write_{region}()"
    for region, settings in component.regions.items():
        yield ""
        yield f"    def _write_{region}(self) -> None:"
        yield f"        region = self.{region}"
        yield from _region(settings)
    for method in distinct_methods(component):
        yield ""
        yield "    @abstractmethod"
        yield from _method(method)


def _region(region: RegionModel) -> Iterator[str]:
    if region.transitions or any(state.inside for state in region.states):
        yield "        states = region.states"
    for state in in_tree_order(region.states):
        container = f"states[{literal(state.inside)}]" if state.inside else "region"
        yield from statement(8, f"{container}.state(", _state(state))
    for transition in region.transitions:
        arguments = [f"states[{literal(transition.target)}]"]
        source = f"states[{literal(transition.source)}]"
        if transition.after:
            yield from statement(8, f"{source}.after(", [literal(transition.after), *arguments])
            continue
        if transition.on:
            arguments.append(f"on={literal(transition.on)}")
        if transition.when:
            arguments.append(f"when=self.{transition.when}")
        if transition.needs:
            arguments.append(f"needs=[{', '.join(map(literal, transition.needs))}]")
        yield from statement(8, f"{source}.to(", arguments)


def _state(state: StateModel) -> Iterator[str]:
    yield literal(state.name)
    for option in ("entry", "exit", "activity"):
        if method := getattr(state, option):
            yield f"{option}=self.{method}"
    yield from _times(state.period, state.estimate)


def _times(period: float, estimate: float) -> Iterator[str]:
    if period:
        yield f"period={period!r}"
    if estimate:
        yield f"estimate={estimate!r}"


def distinct_methods(component: ComponentModel) -> list[Method]:
    """Return the methods that the user writes, each once.

    The model may name a method in several places. The last place decides the method's position, the
    first its docstring.
    """
    last_first = reversed(list(methods(component)))
    return list({method.name: method for method in last_first}.values())[::-1]


def _method(method: Method) -> Iterator[str]:
    yield f"    {method.signature}"
    yield f'        """{method.about}"""'


# --- the files of components, which are written once ----------------------------------------------


def component_module(model: ApplicationModel, name: str, package: str) -> Iterator[str]:
    """Yield the lines of a component's module, which the user then changes."""
    component = model.components[name]
    yield f'"""Component {name}. tca generate has created this file, and does not change it."""'
    yield ""
    names = {f"{package}generated": [f"{name}Base"]}
    for kind in {
        input_.type: None for input_ in component.inputs.values() if input_.type in model.types
    }:
        names.setdefault(model.types[kind].module or f"{package}generated", []).append(kind)
    for module in sorted(names):
        yield from import_lines(module, names[module])
    yield from _class("", f"{name}({name}Base)", f"The activities of {name}.")
    for method in distinct_methods(component):
        yield ""
        yield from stub_method(method)


def stub_method(method: Method) -> Iterator[str]:
    """Yield the lines of a method that does nothing yet."""
    yield from _method(method)
    if method.is_guard:
        yield "        return False"


# --- the application ------------------------------------------------------------------------------


_APPLICATION = '''"""The components of {model}.toml, connected: {mark}.

Do not change this file: changes would be lost.
"""
# isort: skip_file

from contextlib import suppress
from threading import Event
from typing import Any

from tca_behaviours.activities import Application
'''


def application_module(model: ApplicationModel, package: str) -> Iterator[str]:
    """Yield the lines of the module that creates the instances and connects them."""
    kinds = sorted({instance.component for instance in model.instances.values()})
    title = model.name.replace("_", " ").replace("-", " ")
    yield from _APPLICATION.format(mark=MARK, model=model.name).splitlines()
    yield from import_lines(
        "tca_behaviours.activities.components",
        ["Component", *["connect"] * bool(model.connections)],
    )
    for kind in kinds:
        yield from import_lines(f"{package}{file_of(kind)}", [kind])
    yield from import_lines(
        f"{package}generated",
        [f"{instance.component}Data" for instance in model.instances.values() if instance.data],
    )
    yield from _class("", "Components", f"The components of {title}.")
    yield ""
    yield "    def __init__(self) -> None:"
    for name, instance in model.instances.items():
        yield from statement(
            8, f"self.{name} = {instance.component}(", _instance_arguments(name, instance)
        )
    yield from statement(
        8, "self.all: list[Component[Any]] = [", [f"self.{name}" for name in model.instances], "]"
    )
    for connection in model.connections:
        ends = [
            f"self.{instance}.{port}" for instance, port in (connection.source, connection.target)
        ]
        yield from statement(8, "connect(", ends)
    yield from _MAIN.format(literal(model.name)).splitlines()


_MAIN = """

def main() -> None:
    \"\"\"Run the application until Ctrl-C, and print the changes of its regions.\"\"\"
    components = Components().all
    for component in components:
        for region in component.regions.values():
            region.on_transition(print)
    with suppress(KeyboardInterrupt), Application({}, components).running():
        Event().wait()


if __name__ == "__main__":
    main()"""


def _instance_arguments(name: str, instance: InstanceModel) -> Iterator[str]:
    yield literal(name)
    if instance.data:
        values = ", ".join(f"{field}={literal(value)}" for field, value in instance.data.items())
        yield f"lambda: {instance.component}Data({values})"


# --- layout: as formatters lay it out, whatever their line length ---------------------------------


def statement(indent: int, head: str, arguments: Iterable[str], tail: str = ")") -> list[str]:
    """Return the lines of a statement: *head*, which ends with a bracket, the arguments, and
    *tail*.
    """
    arguments, space = list(arguments), " " * indent
    return _laid_out(f"{space}{head}{', '.join(arguments)}{tail}", space, head, arguments, tail)


def import_lines(module: str, names: Iterable[str]) -> list[str]:
    """Return the lines that import names from a module; none if there are no names."""
    names = sorted(set(names), key=lambda name: (not name.isupper(), name.lower()))
    line = f"from {module} import {', '.join(names)}"
    return _laid_out(line, "", f"from {module} import (", names, ")") if names else []


def _laid_out(line: str, space: str, head: str, parts: list[str], tail: str) -> list[str]:
    """Return the line. If the line is too long, return *head*, a line for each part, and *tail*."""
    if len(line) <= _LONGEST:
        return [line]
    return [f"{space}{head}", *(f"{space}    {part}," for part in parts), f"{space}{tail}"]


def literal(value: object) -> str:
    """Return the Python literal of a value."""
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    return repr(value) if not isinstance(value, float) or isfinite(value) else f'float("{value}")'
