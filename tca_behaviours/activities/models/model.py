"""The content of an application's file. A number of seconds is 0 if the file gives none."""

from typing import Annotated

import msgspec
from msgspec import Meta

Name = Annotated[str, Meta(min_length=1, description="a name in quotes")]
Names = Annotated[
    list[str], Meta(description='a list of names in quotes, such as ["enabling.enabled"]')
]
Seconds = Annotated[float, Meta(gt=0, le=86400, description="a number of seconds above 0")]
TABLE = Meta(description="a table")
Values = Annotated[
    dict[str, int | float | str | bool],
    Meta(description="a table of numbers, texts, true and false"),
]

StateName = Annotated[
    str,
    Meta(
        pattern="^(?!machine$)[A-Za-z][A-Za-z0-9_ -]{0,39}$",
        description="a name in quotes, of letters, digits, ' ', '-' and '_'; not 'machine'",
    ),
]

PLAIN_TYPES = ("bool", "float", "int", "str")


class TypeModel(msgspec.Struct, frozen=True):
    """A type of data that ports pass: fields with their types, or a class of a module."""

    fields: dict[str, str] = {}
    module: str = ""
    """The module from which the class is imported; "" if it has fields."""


class InputModel(msgspec.Struct, frozen=True):
    """An input port."""

    type: Name
    keep: Annotated[
        int, Meta(ge=1, le=1_000_000, description="a whole number of values, 1 or more")
    ] = 1


class StateModel(msgspec.Struct, frozen=True, kw_only=True):
    """A state of a region: a row of ``states``."""

    name: StateName
    inside: Annotated[str, Meta(description="the name of the state that holds it")] = ""
    initial: Annotated[bool, Meta(description="true or false")] = False
    entry: Annotated[str, Meta(description="the name of a method")] = ""
    exit: Annotated[str, Meta(description="the name of a method")] = ""
    activity: Annotated[str, Meta(description="the name of a method")] = ""
    period: Seconds = 0.0
    estimate: Seconds = 0.0


class TransitionModel(msgspec.Struct, frozen=True, kw_only=True):
    """A transition of a region: a row of ``transitions``."""

    source: Name = msgspec.field(name="from")
    target: Name = msgspec.field(name="to")
    on: Annotated[str, Meta(description="the name of an event")] = ""
    when: Annotated[str, Meta(description="the name of a method")] = ""
    needs: Names = []
    after: Seconds = 0.0


_ROWS = 'a list of tables, such as [{ name = "stopped" }]'


class RegionModel(msgspec.Struct, frozen=True, kw_only=True):
    """A region."""

    period: Seconds
    estimate: Seconds = 0.0
    states: Annotated[list[StateModel], Meta(min_length=1, description=_ROWS)]
    transitions: Annotated[list[TransitionModel], Meta(description=_ROWS)] = []


class ComponentModel(msgspec.Struct, frozen=True, kw_only=True):
    """A kind of component."""

    period: Seconds = 0.0
    estimate: Seconds = 0.0
    data: Values = {}
    """The first values of the data's fields. The types of the fields follow from these values."""
    inputs: Annotated[dict[str, InputModel], TABLE] = {}
    outputs: Annotated[dict[str, str], TABLE] = {}
    """The types of the output ports, by name."""
    regions: Annotated[dict[str, RegionModel], TABLE] = {}


class InstanceModel(msgspec.Struct, frozen=True, kw_only=True):
    """A component of the application."""

    component: Name
    data: Values = {}
    """The first values of this instance that differ from those of its ComponentModel."""


class ConnectionModel(msgspec.Struct, frozen=True):
    """An output port, and the input port that receives its values."""

    source: tuple[str, str]
    target: tuple[str, str]


class ApplicationModel(msgspec.Struct, frozen=True):
    """The content of a file."""

    name: str
    types: dict[str, TypeModel]
    components: dict[str, ComponentModel]
    instances: dict[str, InstanceModel]
    connections: list[ConnectionModel]
