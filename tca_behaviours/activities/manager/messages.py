"""The variables and commands of an application in central. Their names contain the application's
name.
"""

import msgspec

from tca_behaviours.activities.components import RegionChange
from tca_behaviours.activities.reports import AllocationReport, ApplicationFigures
from tca_module import Command, Failure, Variable
from tca_module.checks import ArgumentKind, check, instance_of, list_of
from tca_wire.charts import MachineChart


class ComponentEntry(msgspec.Struct, frozen=True):
    """A component and its regions."""

    name: str
    regions: list[MachineChart]


class ControlField(msgspec.Struct, frozen=True):
    """A number that the user gives with a control."""

    name: str
    """The field of the message's data; "": the number is the whole data."""
    value: float
    """The first value."""
    unit: str = ""
    least: float | None = None
    most: float | None = None


_NAME = instance_of("a name, such as MESSAGE.name", str)
_DATA = ArgumentKind(
    "a dictionary of texts, numbers and bools, such as {'': ...} for the whole data",
    lambda data: (
        isinstance(data, dict)
        and all(isinstance(value, str | int | float) for value in data.values())
    ),
)
_FIELDS = list_of("a list of ControlFields", instance_of("a ControlField", ControlField))


class Control(msgspec.Struct, frozen=True):
    """A button of the page, which sends a command or inform to the application's program."""

    label: str
    message: str
    """The name of the message."""
    data: dict[str, str | float | bool] = {}
    """The fields of the data; the name "" means the whole data."""
    fields: list[ControlField] = []
    group: str = ""
    """A heading above consecutive controls of the same group."""

    def __post_init__(self) -> None:
        call = f"control '{self.label}'"
        check(call, _NAME, message=self.message)
        check(call, _DATA, data=self.data)
        check(call, _FIELDS, fields=self.fields)


class ApplicationEntry(msgspec.Struct, frozen=True):
    """The data of an application that do not change while its program runs."""

    name: str
    module: str
    """The name of the manager's module."""
    components: list[ComponentEntry]
    policies: list[str]
    controls: list[Control]


class StatesReport(msgspec.Struct, frozen=True):
    """The active leaf of each region, and all transitions since the last report."""

    states: dict[str, str]
    changes: list[RegionChange]


class ActivityMove(msgspec.Struct, frozen=True):
    """The move of an activity to an existing or a new processor. With "" as the processor, the
    activity is removed from its processor.
    """

    activity: str
    processor: str
    position: int | None = None
    """The place among the processor's activities, from 0; None: the last."""


class ActivityPeriod(msgspec.Struct, frozen=True):
    """A new period for an activity, in seconds."""

    activity: str
    period: float


class ProcessorPriority(msgspec.Struct, frozen=True):
    """A new priority for a processor. The processor with the higher priority goes first."""

    processor: str
    priority: int


REFUSED = Failure("application refused")
"""An application can't carry out a command; the text gives the reason."""

APPLICATION = "application "
"""The start of the names of variables that describe applications."""


class ApplicationMessages:
    """The messages of an application.

    Args:
        name: the name of the application.
    """

    def __init__(self, name: str) -> None:
        self.application = Variable(f"{APPLICATION}{name}", ApplicationEntry)
        self.allocation = Variable(f"activities of {name}", AllocationReport)  #: on every change
        #: On changes, at most ten times a second.
        self.states = Variable(f"states of {name}", StatesReport)
        self.figures = Variable(f"figures of {name}", ApplicationFigures)  #: once a second
        #: SVG, on changes, at most five times a second.
        self.picture = Variable(f"picture of {name}", str)
        self.allocate = Command(f"allocate activities of {name}", dict[str, list[str]])
        """The activities of each processor, in order of subscription."""
        self.move = Command(f"move activity of {name}", ActivityMove)
        self.set_period = Command(f"set period in {name}", ActivityPeriod)
        self.set_priority = Command(f"set priority in {name}", ProcessorPriority)
        self.set_policy = Command(f"set policy of {name}", str)
        self.initialise = Command(f"initialise {name}")
        self.start = Command(f"start {name}")
        self.stop = Command(f"stop {name}")
