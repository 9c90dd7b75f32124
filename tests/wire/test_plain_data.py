"""Plain values as data of a format that is known only by its schema. A value arrives whole, or its
misfit is named.
"""

import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, date, datetime, time, timedelta
from decimal import Decimal
from enum import Enum
from typing import Annotated, Any, Literal, TypedDict
from uuid import UUID

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from sampling import lives

from tca_wire.errors import BadData
from tca_wire.messages.declarations import Command
from tca_wire.messages.formats import Format
from tca_wire.messages.schemas import schema_text
from tca_wire.text.plain_data import Bare, PlainFormat


class Side(Enum):
    LEFT = "left"
    RIGHT = "right"


@dataclass
class Pose:
    x: float
    y: float = 0.0


@dataclass
class Move:
    leg: int
    to: Pose
    side: Side = Side.LEFT
    notes: list[str] = field(default_factory=list)
    speed: Annotated[float, msgspec.Meta(gt=0, le=2)] | None = None


class Circle(msgspec.Struct, tag="circle"):
    radius: float


class Line(msgspec.Struct, tag="line"):
    ends: tuple[Pose, Pose]


class Pair(msgspec.Struct, array_like=True):
    first: int
    second: str = ""


class Tree(msgspec.Struct):
    name: str
    branches: "list[Tree]" = []


class Options(TypedDict, total=False):
    speed: float


class Diary(msgspec.Struct):
    entries: "dict[date, Diary]" = {}
    at: datetime | None = None


AWARE = Annotated[datetime, msgspec.Meta(tz=True)]
NAIVE = Annotated[datetime, msgspec.Meta(tz=False)]
ARRAY = NDArray[np.float64]


def received(kind: Any, value: Any) -> Any:
    """Return the value that a receiver with the declared *kind* gets."""
    schema = schema_text(kind)
    return Format(kind).decode(PlainFormat(schema).encode(value))


def complaint(kind: Any, value: Any) -> str:
    with pytest.raises(BadData) as error:
        PlainFormat(schema_text(kind)).encode(value)
    return str(error.value)


VALUES: list[tuple[Any, Any]] = [
    (int, -3),
    (float, 2.5),
    (bool, True),
    (str, "5"),
    (bytes, b"\x00\xff"),
    (None, None),
    (Side, Side.RIGHT),
    (Pose, Pose(1.0, 2.0)),
    (Move, Move(3, Pose(1.0), Side.RIGHT, ["a"], 1.5)),
    (Circle | Line, Line((Pose(1), Pose(2)))),
    (Pair, Pair(1, "b")),
    (Tree, Tree("a", [Tree("b", [Tree("c")])])),
    (Options, {"speed": 1.0}),
    (Options, {}),
    (datetime, datetime(2024, 2, 3, tzinfo=UTC)),
    (date, date(2024, 2, 3)),
    (timedelta, timedelta(seconds=1.5)),
    (UUID, UUID(int=7)),
    (dict[str, int], {"a": 1}),
    (dict[str, Pose], {"a": Pose(1.0)}),
    (list[int], [1, 2]),
    (tuple[int, str], (1, "a")),
    (tuple[int, ...], (1, 2)),
    (set[int], {1}),
    (int | None, None),
    (str | int, "5"),
    (Literal["a", 3], 3),
    (Any, {"x": [1, None]}),
    (dict, {"x": 1}),
    (list, [1, "a"]),
    (time, time(12, 30)),
    (AWARE, datetime(2024, 2, 3, tzinfo=UTC)),
    (Decimal, Decimal("1.5")),
    (dict[int, int], {1: 2}),
    (dict[float, int], {1.5: 2}),
    (dict[str, int], {"1": 2}),
    (dict[Any, int], {"1": 2}),
    (dict[date, Side], {date(2024, 2, 3): Side.LEFT}),
    (dict[Side, int], {Side.LEFT: 1}),
    (dict[Literal["a", 3], int], {3: 1, "a": 2}),
]


@pytest.mark.parametrize(("kind", "value"), VALUES, ids=lambda part: repr(part)[:30])
def test_json_value_arrives_as_the_declared_type(kind: Any, value: Any) -> None:
    text = msgspec.json.encode(value).decode()
    assert received(kind, json.loads(text)) == received(kind, Bare(text)) == value


@given(
    st.recursive(
        st.none()
        | st.booleans()
        | st.integers(-(2**63), 2**63)
        | st.floats(allow_nan=False)
        | st.text(),
        lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    )
)
@settings(max_examples=lives(10, soak=100))
def test_unrestricted_format_accepts_every_value(value: object) -> None:
    assert received(Any, value) == value


def test_typed_text_is_json_where_it_fits_and_else_text() -> None:
    typed = {
        "leg": Bare("3"),
        "to": {"x": Bare("1")},
        "side": Bare("right"),
        "notes": Bare('["a", "5"]'),
    }
    assert received(Move, typed) == Move(3, Pose(1.0), Side.RIGHT, ["a", "5"])
    assert received(str, Bare("5")) == "5"
    assert received(str, Bare('"five"')) == "five"
    assert received(str | int, Bare("5")) == 5
    assert received(datetime, Bare("2024-02-03T12:00:00Z")) == datetime(2024, 2, 3, 12, tzinfo=UTC)
    assert received(str | None, Bare("null")) is None
    assert received(Any, {"a": Bare("[1]"), "b": [Bare("[1")]}) == {"a": [1], "b": ["[1"]}
    assert received(Pose, Bare('{"x": 1}')) == Pose(1.0)
    assert complaint(int, Bare("five")) == 'the data must be a whole number, not "five"'
    assert complaint(Pose, Bare("[1]")) == "the data must be an object with x, y, not [1]"


def test_misfit_is_named_by_its_field(approve: Callable[..., None]) -> None:
    approve("complaints.txt", lambda case: complaint(*eval(case)))


def test_formats_with_fields_are_recognised() -> None:
    with_fields = [
        kind
        for kind in (Pose, Pose | None, Circle | Line, dict[str, int], Any)
        if plain(kind).takes_fields
    ]
    assert len(with_fields) == 5
    assert not any(
        plain(kind).takes_fields for kind in (int, str | None, list[Pose], Side, Pair, None)
    )


def plain(kind: Any) -> PlainFormat:
    return PlainFormat(schema_text(kind))


def test_malformed_schema_or_deep_value_raises_only_bad_data() -> None:
    endless = '{"$ref":"#/$defs/A","$defs":{"A":{"$ref":"#/$defs/A"}}}'
    for schema in (
        "",
        "no json",
        "[]",
        "3",
        endless,
        '{"type":["integer"]}',
        '{"pattern":"(","type":"string"}',
        '{"minimum":"a","type":"integer"}',
        '{"anyOf":3}',
        "[" * 5000,
    ):
        values: list[Any] = ["a", 3, {"x": 1}, [], None]
        for value in values:
            try:
                PlainFormat(schema).encode(value)
            except BadData:
                continue
    nested: list[Any] = []
    for _ in range(100_000):
        nested = [nested]
    assert "nested too deeply" in complaint(list[Any], nested)
    assert received(Any, Bare("[" * 100_000)) == "[" * 100_000


def test_message_can_be_declared_by_its_schemas() -> None:
    typed = Command("move", Move, result=Pose)
    untyped: Command[Any, Any] = Command(
        "move", PlainFormat(typed.format.data), result=PlainFormat(typed.format.reply)
    )
    assert untyped.format == typed.format
    with pytest.raises(
        BadData, match="command 'move' wants data of type Move: field 'leg' is missing"
    ):
        untyped.encode_data({})
    assert untyped.decode_reply(typed.encode_reply(Pose(1.0))) == {"x": 1.0, "y": 0.0}


@pytest.mark.parametrize(
    "schema",
    [
        '{"$defs":[],"$ref":"#/$defs/a"}',
        '{"type":"object","properties":[]}',
        '{"type":"object","properties":{"x":7},"required":[{}]}',
        '{"type":"array","prefixItems":7}',
        '{"anyOf":[7,[]]}',
        '{"anyOf":7}',
        '{"enum":true}',
        '{"anyOf":[{}],"discriminator":{"propertyName":[],"mapping":[]}}',
        "[" * 100_000,
        '{"items":' * 100_000,
    ],
)
def test_malformed_schema_is_usable_as_a_format(schema: str) -> None:
    """Any program may declare a message, and `tca send` reads its schema."""
    plain_format = PlainFormat(schema)
    assert str(plain_format)
    assert plain_format.takes_fields in (True, False)
    for value in ({"x": Bare("1")}, [1], "x", None):
        with suppress(BadData):
            assert plain_format.encode(value)
