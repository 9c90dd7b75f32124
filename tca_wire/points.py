"""The moments of a task: three intervals with a start and an end each."""

from enum import IntFlag, StrEnum
from typing import NewType

import msgspec

TaskId = NewType("TaskId", int)

ROOT = TaskId(0)
"""The parent of every top-level task; it is always being achieved."""

THIS = TaskId(-1)
"""In the constraints of a sent message: the task that the message becomes."""


class Interval(StrEnum):
    """The intervals of a task (TCA 8.5 manual, temporal constraints): three spans that overlap.

    Attributes:
        HANDLING: its handler runs.
        PLANNING: it and all below it are expanded.
        ACHIEVING: it and all below it are done.
    """

    HANDLING = "handling"
    PLANNING = "planning"
    ACHIEVING = "achieving"


class Edge(StrEnum):
    """The two ends of an interval.

    Attributes:
        START: the start of the interval.
        END: the end of the interval.
    """

    START = "start"
    END = "end"


class Moment(IntFlag):
    """An edge of an interval, as a bit, so that a set of moments is one small integer.

    Attributes:
        START_HANDLING: its handler starts.
        END_HANDLING: its handler has returned.
        START_PLANNING: its planning starts.
        END_PLANNING: it is planned, with all below it.
        START_ACHIEVING: its achievement starts.
        END_ACHIEVING: it is achieved, with all below it.
    """

    START_HANDLING = 1
    END_HANDLING = 2
    START_PLANNING = 4
    END_PLANNING = 8
    START_ACHIEVING = 16
    END_ACHIEVING = 32


START_HANDLING, END_HANDLING = int(Moment.START_HANDLING), int(Moment.END_HANDLING)
START_PLANNING, END_PLANNING = int(Moment.START_PLANNING), int(Moment.END_PLANNING)
START_ACHIEVING, END_ACHIEVING = int(Moment.START_ACHIEVING), int(Moment.END_ACHIEVING)
"""The moments as plain integers, for sets of moments: ``|`` of two IntFlags costs a microsecond."""

MOMENTS = tuple(Moment)
ALL_MOMENTS = 63
STARTS = START_HANDLING | START_PLANNING | START_ACHIEVING
ENDS = END_HANDLING | END_PLANNING | END_ACHIEVING

_WORDS = {int(moment): str(moment.name).lower().replace("_", " ") for moment in MOMENTS}


def moment_of(interval: Interval, edge: Edge) -> Moment:
    """Return the moment at which *interval* starts or ends."""
    return Moment[f"{edge.name}_{interval.name}"]


def start_of(moment: int) -> int:
    """Return the start of the interval that a moment starts or ends."""
    return moment if moment & STARTS else moment >> 1


def describe_moments(moments: int) -> list[str]:
    """Return the moments in a set, as words: ``["start handling", "start planning"]``."""
    bits = int(moments)
    return [words for moment, words in _WORDS.items() if bits & moment]


class Point(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True, gc=False):
    """One moment of one task: ``Point(task=7, moment=Moment.END_ACHIEVING)``."""

    task: TaskId
    moment: Moment

    def __str__(self) -> str:
        words = _WORDS.get(self.moment, f"moment {int(self.moment)} of")
        return f"{words} {'this task' if self.task == THIS else f'task {self.task}'}"
