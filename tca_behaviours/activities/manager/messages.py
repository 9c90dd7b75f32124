"""What an application tells central, and the commands that it takes. Their names have the
application's in them.
"""

import msgspec

from tca_behaviours.activities.components import RegionChange
from tca_behaviours.activities.reports import AllocationReport, ApplicationFigures
from tca_module import Command, Failure, Variable
from tca_module.checks import ArgumentKind, check, instance_of, list_of
from tca_wire.charts import MachineChart


class ComponentEntry(msgspec.Struct, frozen=True):
    """A component."""

    name: str
    regions: list[MachineChart]


class ControlField(msgspec.Struct, frozen=True):
    """A number that is given with a control."""

    name: str
    """Of the field of the message's data; empty: the number is the whole data."""
    value: float
    """At first."""
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
    """A button of the page: it sends a command or inform of the application's program."""

    label: str
    message: str
    """Its name."""
    data: dict[str, str | float | bool] = {}
    """Its fields; with an empty name: the whole data."""
    fields: list[ControlField] = []
    group: str = ""
    """A heading for controls that follow one another."""

    def __post_init__(self) -> None:
        call = f"control '{self.label}'"
        check(call, _NAME, message=self.message)
        check(call, _DATA, data=self.data)
        check(call, _FIELDS, fields=self.fields)


class ApplicationEntry(msgspec.Struct, frozen=True):
    """What does not change while an application's program runs."""

    name: str
    module: str
    """In which it is managed."""
    components: list[ComponentEntry]
    policies: list[str]
    controls: list[Control]


class StatesReport(msgspec.Struct, frozen=True):
    """The leaf that is active in each region, and all transitions since the report before."""

    states: dict[str, str]
    changes: list[RegionChange]


class ActivityMove(msgspec.Struct, frozen=True):
    """Have another processor tick an activity: one that is there, or a new one; empty: none ticks
    it any more.
    """

    activity: str
    processor: str
    position: int | None = None
    """Among those of the processor, 0 for the first; None: the last."""


class ActivityPeriod(msgspec.Struct, frozen=True):
    """Change the period of an activity."""

    activity: str
    period: float


class ProcessorPriority(msgspec.Struct, frozen=True):
    """Change the priority of a processor; the higher one goes first."""

    processor: str
    priority: int


REFUSED = Failure("application refused")
"""A command that an application can't carry out; its text says why."""

APPLICATION = "application "
"""Variables that begin so tell which applications there are."""


class ApplicationMessages:
    """The messages of the application of that name."""

    def __init__(self, name: str) -> None:
        self.application = Variable(f"{APPLICATION}{name}", ApplicationEntry)
        self.allocation = Variable(f"activities of {name}", AllocationReport)  #: on every change
        self.states = Variable(
            f"states of {name}", StatesReport
        )  #: on changes, at most ten times a second
        self.figures = Variable(f"figures of {name}", ApplicationFigures)  #: once a second
        self.picture = Variable(
            f"picture of {name}", str
        )  #: SVG, on changes, at most five times a second
        self.allocate = Command(f"allocate activities of {name}", dict[str, list[str]])
        """The activities of each processor, in order of subscription."""
        self.move = Command(f"move activity of {name}", ActivityMove)
        self.set_period = Command(f"set period in {name}", ActivityPeriod)
        self.set_priority = Command(f"set priority in {name}", ProcessorPriority)
        self.set_policy = Command(f"set policy of {name}", str)
        self.initialise = Command(f"initialise {name}")
        self.start = Command(f"start {name}")
        self.stop = Command(f"stop {name}")
