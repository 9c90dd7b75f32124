"""Reads the file of a model. Errors say where, what is wrong, and what to do."""

import re
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec
from msgspec import Meta

from tca_behaviours.activities.models.model import (
    PLAIN_TYPES,
    ApplicationModel,
    ComponentModel,
    ConnectionModel,
    InputModel,
    InstanceModel,
    RegionModel,
    Seconds,
    StateModel,
    Table,
    TransitionModel,
    TypeModel,
    Word,
)  # fmt: skip
from tca_behaviours.activities.models.names import (
    FILES,
    check_attributes,
    check_class,
    check_name,
    check_state,
    file_of,
)
from tca_behaviours.activities.models.statecharts import check_estimate, check_region
from tca_tools.errors import BadUserFile
from tca_tools.user_toml import check_known, check_table, read_table, read_toml, shown


class _File(msgspec.Struct):
    components: Table
    types: Table = {}
    instances: Table = {}
    connections: Table = {}


class _Component(msgspec.Struct):
    period: Seconds = 0.0
    estimate: Seconds = 0.0
    data: Table = {}
    inputs: Table = {}
    outputs: Table = {}
    regions: Table = {}


_Rows = Annotated[list[dict[str, Any]], Meta(description='a list of tables, such as [{ name = "stopped" }]')]


class _Region(msgspec.Struct):
    period: Seconds
    states: _Rows
    estimate: Seconds = 0.0
    transitions: _Rows = []


class _Instance(msgspec.Struct):
    component: Word
    data: Table = {}


def read_model(path: Path) -> ApplicationModel:
    """The model of a file. Raises BadUserFile."""
    tables = read_toml(path)
    if not re.fullmatch(r"[\w.-]+", path.stem):
        raise BadUserFile(f"{path}: choose another name for the file, of letters, digits, '.', '-' and '_'")
    try:
        return model_of(path.stem, tables)
    except BadUserFile as error:
        raise BadUserFile(f"{path}: {error}") from None


def model_of(name: str, tables: dict[str, Any]) -> ApplicationModel:
    """The model that the tables of a file hold. Raises BadUserFile."""
    file = _tables(tables)
    types: dict[str, TypeModel] = {}
    for kind, fields in file.types.items():
        types[kind] = _type(kind, fields, types)
    components = {kind: _component(kind, table, types) for kind, table in file.components.items()}
    _check_classes(types, components)
    instances = {one: _instance(one, given, components) for one, given in file.instances.items()}
    model = ApplicationModel(name, types, components, instances, [])
    for one, outputs in file.connections.items():
        model.connections.extend(_connections(model, one, outputs))
    return model


def _tables(tables: dict[str, Any]) -> _File:
    for key, table in tables.items():
        check_known("top level", "table", key, _File.__struct_fields__)
        check_table(key, table)
    if not tables.get("components"):
        raise BadUserFile("there is no component: add a table [components.NAME]")
    return msgspec.convert(tables, _File)


def _check_classes(types: Iterable[str], components: Iterable[str]) -> None:
    """That no class or module that is written has the name of another."""
    classes = {name: f"types.{name}" for name in types}
    files = dict.fromkeys(FILES, "tca generate itself") | dict.fromkeys(sys.stdlib_module_names, "Python")
    for kind in components:
        place, file = f"components.{kind}", file_of(kind)
        for name in (kind, f"{kind}Data", f"{kind}Base"):
            if name in classes:
                raise BadUserFile(f"{place}: its class {name} would be that of {classes[name]}: choose another name")
            classes[name] = place
        if file in files:
            raise BadUserFile(f"{place}: its file {file}.py would be that of {files[file]}: choose another name")
        files[file] = place


# --- types and components -------------------------------------------------------------------------------------------


def _type(name: str, given: Any, known: dict[str, TypeModel]) -> TypeModel:
    place = f"types.{name}"
    check_class(place, name)
    if isinstance(given, str):
        module, _, kind = given.partition(":")
        if kind != name or not all(part.isidentifier() for part in module.split(".")):
            raise BadUserFile(f'{place} must be "MODULE:{name}" or a table of fields, not {shown(given)}')
        return TypeModel(name, module=module)
    if not isinstance(given, dict):
        raise BadUserFile(f'{place} must be "MODULE:{name}" or a table of fields, not {shown(given)}')
    for field, kind in given.items():
        check_name(f"{place}.{field}", field)
        _check_type(f"{place}.{field}", kind, known)
    return TypeModel(name, given)


def _check_type(place: str, name: Any, types: dict[str, TypeModel]) -> None:
    if not isinstance(name, str):
        raise BadUserFile(f"{place} must be the name of a type in quotes, not {shown(name)}")
    check_known(place, "type", name, [*PLAIN_TYPES, *types])


def _component(name: str, given: Any, types: dict[str, TypeModel]) -> ComponentModel:
    place = f"components.{name}"
    check_class(place, name)
    table = read_table(_Component, place, given)
    for field, value in table.data.items():
        check_name(f"{place}.data.{field}", field)
        if not isinstance(value, float | int | str | bool):
            raise BadUserFile(f"{place}.data.{field} must be a number, a text, true or false, not {shown(value)}")
    inputs = {port: _input(f"{place}.inputs.{port}", row, types) for port, row in table.inputs.items()}
    for port, kind in table.outputs.items():
        _check_type(f"{place}.outputs.{port}", kind, types)
    if inputs and not table.period:
        raise BadUserFile(f"{place}.period is missing: it has input ports, so add the period of its port handler")
    regions = [_region(f"{place}.regions.{region}", region, row) for region, row in table.regions.items()]
    component = ComponentModel(
        name=name, period=table.period, estimate=table.estimate, data=table.data, inputs=inputs, outputs=table.outputs,
        regions=regions,
    )  # fmt: skip
    check_attributes(place, component)
    check_estimate(place, table.period, table.estimate)
    for one in regions:
        check_region(f"{place}.regions.{one.name}", one, {region.name: region for region in regions})
    return component


def _input(place: str, given: Any, types: dict[str, TypeModel]) -> InputModel:
    port = read_table(InputModel, place, _in_short(place, "type", given))
    _check_type(place, port.type, types)
    return port


def _in_short(place: str, key: str, given: Any) -> dict[str, Any]:
    """A table of which one key is enough, or that alone."""
    if not isinstance(given, str | dict):
        raise BadUserFile(f"{place} must be a {key} in quotes, or a table, not {shown(given)}")
    return {key: given} if isinstance(given, str) else given


def _region(place: str, name: str, given: Any) -> RegionModel:
    table = read_table(_Region, place, given)
    if not table.states:
        raise BadUserFile(f"{place}.states is empty: add a state")
    states = []
    for number, row in enumerate(table.states, 1):
        state = read_table(StateModel, f"{place}.states.{row.get('name', number)}", row)
        check_state(f"{place}.states.{state.name}", state.name)
        states.append(state)
    transitions = []
    for number, row in enumerate(table.transitions, 1):
        transitions.append(read_table(TransitionModel, f"{place}.transitions.{number}", row))
    return RegionModel(name=name, period=table.period, estimate=table.estimate, states=states, transitions=transitions)


# --- instances and connections --------------------------------------------------------------------------------------


def _instance(name: str, given: Any, components: dict[str, ComponentModel]) -> InstanceModel:
    place = f"instances.{name}"
    check_name(place, name)
    if name == "all":
        raise BadUserFile(f"{place}: 'all' is the list of all instances in application.py: choose another name")
    table = read_table(_Instance, place, _in_short(place, "component", given))
    check_known(place, "component", table.component, components)
    data = components[table.component].data
    for field, value in table.data.items():
        check_known(f"{place}.data", "field", field, data)
        if type(value) is not type(data[field]) and (type(value), type(data[field])) != (int, float):
            raise BadUserFile(f"{place}.data.{field} must be like {shown(data[field])}, not {shown(value)}")
    return InstanceModel(name, table.component, table.data)


def _connections(model: ApplicationModel, instance: str, given: Any) -> list[ConnectionModel]:
    place = f"connections.{instance}"
    if not isinstance(given, dict):
        raise BadUserFile(f'{place} must be a table: write {instance}.PORT = "INSTANCE.PORT"')
    return [
        _connection(model, (instance, port), target)
        for port, targets in given.items()
        for target in (targets if isinstance(targets, list) else [targets])
    ]


def _connection(model: ApplicationModel, source: tuple[str, str], given: Any) -> ConnectionModel:
    place = f"connections.{'.'.join(source)}"
    target = tuple(given.split(".")) if isinstance(given, str) else ()
    if len(target) != 2:
        raise BadUserFile(f'{place} must be "INSTANCE.PORT", or a list of such, not {shown(given)}')
    sending, taking = _kind_of(model, place, source[0]), _kind_of(model, place, target[0])
    output = _port(place, source, sending.outputs, sending.inputs, "an output")
    input_ = _port(place, (target[0], target[1]), taking.inputs, taking.outputs, "an input")
    if output != input_.type and (output, input_.type) != ("int", "float"):
        raise BadUserFile(f"{place} is of type {output}, and {given} of type {input_.type}: give both the same type")
    return ConnectionModel(source, (target[0], target[1]))


def _kind_of(model: ApplicationModel, place: str, instance: str) -> ComponentModel:
    check_known(place, "instance", instance, model.instances)
    return model.components[model.instances[instance].component]


_T = TypeVar("_T")


def _port(place: str, port: tuple[str, str], ports: dict[str, _T], others: dict[str, Any], wanted: str) -> _T:
    if port[1] in others:
        raise BadUserFile(f'{place}: {".".join(port)} is not {wanted} port: write OUTPUT = "INPUT"')
    check_known(f"{place}, instance '{port[0]}'", "port", port[1], ports)
    return ports[port[1]]
