"""Reads the file of a model. An error names the place, the problem and the remedy."""

import re
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TypeVar

from tca_behaviours.activities.models.model import (
    PLAIN_TYPES,
    ApplicationModel,
    ComponentModel,
    ConnectionModel,
    InstanceModel,
    TypeModel,
)
from tca_behaviours.activities.models.names import (
    FILES,
    check_attributes,
    check_class,
    check_name,
    file_of,
)
from tca_behaviours.activities.models.statecharts import check_estimate, check_region
from tca_tools.errors import BadUserFile
from tca_tools.user_toml import check_known, check_table, read_table, read_toml, shown


def read_model(path: Path) -> ApplicationModel:
    """Return the model of a file. Raises BadUserFile."""
    tables = read_toml(path)
    if not re.fullmatch(r"[\w.-]+", path.stem):
        raise BadUserFile(
            f"{path}: choose another name for the file, of letters, digits, '.', '-' and '_'"
        )
    try:
        return model_of(path.stem, tables)
    except BadUserFile as error:
        raise BadUserFile(f"{path}: {error}") from None


def model_of(name: str, tables: dict[str, Any]) -> ApplicationModel:
    """Return the model in the tables of a file. Raises BadUserFile."""
    _check_tables(tables)
    types: dict[str, TypeModel] = {}
    for kind, fields in tables.get("types", {}).items():
        types[kind] = _type(kind, fields, types)
    components = {
        kind: _component(kind, table, types) for kind, table in tables["components"].items()
    }
    _check_classes(types, components)
    given = _expanded(tables.get("instances", {}), "component")
    instances = {label: _instance(label, table, components) for label, table in given.items()}
    model = ApplicationModel(name, types, components, instances, [])
    for instance, outputs in tables.get("connections", {}).items():
        model.connections.extend(_connections(model, instance, outputs))
    return model


def _check_tables(tables: dict[str, Any]) -> None:
    for key, table in tables.items():
        check_known("top level", "table", key, ("components", "types", "instances", "connections"))
        check_table(key, table)
    if not tables.get("components"):
        raise BadUserFile("the model has no component: add a table [components.NAME]")


def _expanded(tables: Any, key: str) -> Any:
    """Expand each text to a table. With *key* "type", ``"float"`` becomes ``{"type": "float"}``."""
    if not isinstance(tables, dict):
        return tables
    return {
        name: {key: given} if isinstance(given, str) else given for name, given in tables.items()
    }


def _check_classes(types: Iterable[str], components: Iterable[str]) -> None:
    """Check that the classes and files that are generated have different names."""
    classes = {name: f"types.{name}" for name in types}
    files = dict.fromkeys(FILES, "tca generate itself") | dict.fromkeys(
        sys.stdlib_module_names, "Python"
    )
    for kind in components:
        place, file = f"components.{kind}", file_of(kind)
        for name in (kind, f"{kind}Data", f"{kind}Base"):
            if name in classes:
                raise BadUserFile(
                    f"{place}: its class {name} clashes with that of {classes[name]}: "
                    "choose another name"
                )
            classes[name] = place
        if file in files:
            raise BadUserFile(
                f"{place}: its file {file}.py clashes with that of {files[file]}: "
                "choose another name"
            )
        files[file] = place


# --- types and components -------------------------------------------------------------------------


def _type(name: str, given: Any, known: dict[str, TypeModel]) -> TypeModel:
    place = f"types.{name}"
    check_class(place, name)
    if isinstance(given, dict):
        for field, kind in given.items():
            check_name(f"{place}.{field}", field)
            _check_type(f"{place}.{field}", kind, known)
        return TypeModel(given)
    module, _, kind = given.partition(":") if isinstance(given, str) else ("", "", "")
    if kind != name or not all(part.isidentifier() for part in module.split(".")):
        raise BadUserFile(
            f'{place} must be "MODULE:{name}" or a table of fields, not {shown(given)}'
        )
    return TypeModel(module=module)


def _check_type(place: str, name: Any, types: dict[str, TypeModel]) -> None:
    if not isinstance(name, str):
        raise BadUserFile(f"{place} must be the name of a type in quotes, not {shown(name)}")
    check_known(place, "type", name, [*PLAIN_TYPES, *types])


def _component(name: str, given: Any, types: dict[str, TypeModel]) -> ComponentModel:
    place = f"components.{name}"
    check_class(place, name)
    if isinstance(given, dict) and "inputs" in given:
        given = {**given, "inputs": _expanded(given["inputs"], "type")}
    component = read_table(ComponentModel, place, given)
    for field in component.data:
        check_name(f"{place}.data.{field}", field)
    for port, input_ in component.inputs.items():
        _check_type(f"{place}.inputs.{port}", input_.type, types)
    for port, kind in component.outputs.items():
        _check_type(f"{place}.outputs.{port}", kind, types)
    if component.inputs and not component.period:
        raise BadUserFile(
            f"{place}.period is missing: it has input ports, so add the period of its port handler"
        )
    check_attributes(place, component)
    check_estimate(place, component.period, component.estimate)
    for region in component.regions:
        check_region(f"{place}.regions.{region}", region, component.regions)
    return component


# --- instances and connections --------------------------------------------------------------------


def _instance(name: str, given: Any, components: dict[str, ComponentModel]) -> InstanceModel:
    place = f"instances.{name}"
    check_name(place, name)
    if name == "all":
        raise BadUserFile(
            f"{place}: 'all' is the list of all instances in application.py: choose another name"
        )
    instance = read_table(InstanceModel, place, given)
    check_known(place, "component", instance.component, components)
    data = components[instance.component].data
    for field, value in instance.data.items():
        check_known(f"{place}.data", "field", field, data)
        kinds = type(value), type(data[field])
        if kinds[0] is not kinds[1] and kinds != (int, float):
            raise BadUserFile(
                f"{place}.data.{field} must be like {shown(data[field])}, not {shown(value)}"
            )
    return instance


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
        raise BadUserFile(f'{place} must be "INSTANCE.PORT" or a list of them, not {shown(given)}')
    sender, receiver = _kind_of(model, place, source[0]), _kind_of(model, place, target[0])
    output = _port(place, source, sender.outputs, sender.inputs, "an output")
    input_ = _port(place, (target[0], target[1]), receiver.inputs, receiver.outputs, "an input")
    if output != input_.type and (output, input_.type) != ("int", "float"):
        raise BadUserFile(
            f"{place} is of type {output}, {given} of type {input_.type}: give both the same type"
        )
    return ConnectionModel(source, (target[0], target[1]))


def _kind_of(model: ApplicationModel, place: str, instance: str) -> ComponentModel:
    """Return the model of an instance's component. Raises BadUserFile for an unknown instance."""
    check_known(place, "instance", instance, model.instances)
    return model.components[model.instances[instance].component]


_T = TypeVar("_T")


def _port(
    place: str, port: tuple[str, str], ports: dict[str, _T], others: dict[str, Any], wanted: str
) -> _T:
    """Return the model of a port. *ports* are those of the wanted direction, *others* those of the
    opposite one.

    Raises BadUserFile.
    """
    if port[1] in others:
        raise BadUserFile(f'{place}: {".".join(port)} is not {wanted} port: write OUTPUT = "INPUT"')
    check_known(f"{place}, instance '{port[0]}'", "port", port[1], ports)
    return ports[port[1]]
