"""Declarations that refer to others: parts of monitors, and kinds of failures. A declaration is
refused if its data do not fit.
"""

from dataclasses import dataclass
from typing import Any

import pytest

from tca_wire.errors import BadFormat
from tca_wire.messages.controls import DemonMonitor, PointMonitor, PollingMonitor
from tca_wire.messages.declarations import Command, Failure, Goal, Inform, Query


@dataclass
class Cup:
    colour: str


@dataclass
class Mug:
    colour: str


@dataclass
class Place:
    x: float


IS_GONE, IS_DARK = Query("is it gone", str, reply=bool), Query("is it dark", reply=bool)
SEEN: Any = Query("seen", reply=Cup | None)
LEVEL: Any = Query("level", reply=float | bool)
ANYTHING = Query("anything", Any, reply=Any)
TAKE_CUP, TAKE_MUG, TAKE_ANY, GO = (
    Goal("take", Cup),
    Goal("take", Mug),
    Goal("take any", Any),
    Goal("go", Place),
)
STOP, SAY, SINK = Command("stop"), Inform("say", str), Command("sink", float)
NONE: Any = None

FIT = [
    (str, IS_GONE, SAY),
    (str, IS_GONE, STOP),
    (str, IS_DARK, SAY),
    (Cup, IS_DARK, TAKE_CUP),
    (Cup, IS_DARK, TAKE_MUG),
    (None, SEEN, TAKE_CUP),
    (None, SEEN, TAKE_ANY),
    (None, SEEN, STOP),
    (None, LEVEL, SINK),
    (int, ANYTHING, TAKE_CUP),
    (Any, IS_GONE, SAY),
]
MISFIT = [
    (None, IS_GONE, None, "the condition 'is it gone' of KIND 'watch' wants data of type str, but gets the monitor's own, N"),
    (int, IS_GONE, None, "wants data of type str, but gets the monitor's own, int: declare both with the same type, or it w"),
    (str, IS_GONE, SINK, "the action 'sink' of KIND 'watch' wants data of type float, but gets the monitor's own, str"),
    (None, IS_DARK, SAY, "the action 'say' of KIND 'watch' wants data of type str, but gets the monitor's own, None"),
    (None, SEEN, GO, "the action 'go' of KIND 'watch' wants data of type Place, but gets the reply of 'seen', "),
    (None, LEVEL, SAY, "but gets the reply of 'level', float | bool"),
    (None, NONE, None, "the condition of KIND 'watch' must be a Query, not None"),
]  # fmt: skip


@pytest.mark.parametrize("kind", [PointMonitor, PollingMonitor])
def test_monitor_is_refused_when_condition_or_action_misfits(kind: Any) -> None:
    for data, condition, action in FIT:
        kind("watch", data, condition=condition, action=action)
    for data, condition, action, words in MISFIT:
        with pytest.raises(BadFormat) as error:
            kind("watch", data, condition=condition, action=action)
        assert words.replace("KIND", str(kind.message_class)) in str(error.value)


def test_demon_monitor_is_refused_when_a_part_misfits() -> None:
    DemonMonitor("watch", Cup, set_up=TAKE_CUP, action=SAY, cancel=STOP)
    for what, part in (("set-up", "set_up"), ("cancel message", "cancel")):
        option: Any = {part: SAY}
        with pytest.raises(
            BadFormat,
            match=f"the {what} 'say' of demon monitor 'watch' wants data of type str, but gets",
        ):
            DemonMonitor("watch", Cup, **option)


def test_failure_is_refused_when_data_misfits_its_general_kind() -> None:
    fit: list[tuple[Any, Any]] = [
        (int, int),
        (int, float),
        (int, None),
        (int, int | None),
        (None, Cup | None),
        (Mug, Cup),
    ]
    misfit: list[tuple[Any, Any]] = [(int | None, int), (float, int), (None, int), (Cup, Place)]
    for has, wants in fit:
        assert Failure("scrape", has, kind_of=Failure("collision", wants)).kinds == ["collision"]
    for has, wants in misfit:
        with pytest.raises(
            BadFormat,
            match=r"'scrape' has data of type .*, but exception handlers of 'collision' get",
        ):
            Failure("scrape", has, kind_of=Failure("collision", wants))
    with pytest.raises(BadFormat, match="the kind_of of failure 'slid' must be a Failure"):
        Failure("slid", kind_of="slipped")  # type: ignore[call-overload]
