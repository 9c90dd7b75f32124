"""User data. A fitting value arrives unchanged, and a misfit is named by its field. Formats are
compared by shape.
"""

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import Enum
from typing import Any, Literal, Self, TypedDict

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from tca_wire.errors import BadData, BadFormat
from tca_wire.messages.declarations import Command, Failure, Goal, Query
from tca_wire.messages.formats import Format, decode_untyped, first_difference
from tca_wire.messages.schemas import schema_text


class Side(Enum):
    LEFT = "left"
    RIGHT = "right"


@dataclass
class Pose:
    x: float
    y: float
    side: Side = Side.LEFT


class Stance(msgspec.Struct):
    feet: list[Pose]
    at: datetime
    note: str | None = None


class Options(TypedDict, total=False):
    speed: float


@dataclass
class Scan:
    heights: NDArray[np.float32]
    raw: bytes


@dataclass
class Tree:
    value: int
    children: "list[Tree]"


POSE = Pose(1.0, 2.0, Side.RIGHT)


@pytest.mark.parametrize(
    ("kind", "value"),
    [
        (Pose, POSE),
        (Stance, Stance([POSE], datetime(2026, 1, 2, tzinfo=UTC))),
        (Options, {"speed": 2.0}),
        (Options, {}),
        (dict[str, list[tuple[int, str]]], {"a": [(1, "b")]}),
        (int | None, None),
        (Side, Side.LEFT),
        (Literal["on", "off"], "on"),
        (Tree, Tree(1, [Tree(2, [])])),
        (set[int], {1, 2}),
        (type(None), None),
    ],
)
def test_value_survives_encoding_and_decoding(kind: Any, value: Any) -> None:
    data = Format[Any](kind)
    assert data.decode(data.encode(value)) == value


def test_numpy_array_arrives_unchanged_and_read_only() -> None:
    data = Format[Scan](Scan)
    sent = Scan(np.arange(6, dtype=np.float32).reshape(2, 3)[:, ::2], b"raw")
    received = data.decode(data.encode(sent))
    assert np.array_equal(received.heights, sent.heights)
    assert received.heights.dtype == np.float32
    with pytest.raises(ValueError, match="read-only"):
        received.heights[0, 0] = 5


STRUCTURED = np.dtype(
    [
        ("position", "<f4", (3,)),
        ("ring", "u1"),
        ("at", "<M8[ns]"),
        ("pair", [("a", "<i2"), ("b", "S4")]),
    ]
)


class Quantity(np.ndarray[Any, np.dtype[np.float64]]):
    """Numbers with a unit, which a plain array has no place for."""

    unit: str

    def __new__(cls, number: float, unit: str) -> Self:
        self = np.full(2, number).view(cls)
        self.unit = unit
        return self


OVERLAPPING = np.dtype({"names": ["a", "b"], "formats": ["<i4", "<i2"], "offsets": [0, 2]})


@pytest.mark.parametrize(
    "dtype",
    [
        "?",
        "i1",
        "<u8",
        ">f8",
        "<f2",
        "<c16",
        "S5",
        "<U3",
        "V10",
        "<M8[ms]",
        "<m8[D]",
        STRUCTURED,
        np.dtype([("x", "i1"), ("y", "<f8")], align=True),
    ],
    ids=str,
)
def test_array_keeps_its_dtype(dtype: Any) -> None:
    sent = np.frombuffer(bytes(range(1, 1 + 2 * np.dtype(dtype).itemsize)), dtype).reshape(2, 1)
    got = Format[Any](np.ndarray).decode(Format[Any](np.ndarray).encode(sent))
    assert got.dtype == sent.dtype
    assert (got.shape, got.tobytes()) == (sent.shape, sent.tobytes())


@pytest.mark.parametrize(
    "dtype",
    ["|O", "<f4", [["x", "|O"]], [["x"]], [["x", "<f4", [2, -1]]], "nonsense", [[["a"], "<f4"]]],
)
def test_damaged_array_description_is_refused(dtype: Any) -> None:
    lie = msgspec.msgpack.encode(
        msgspec.msgpack.Ext(1, msgspec.msgpack.encode([dtype, [1], b"12345678"]))
    )
    with pytest.raises(BadData, match="damaged array"):
        Format[Any](np.ndarray).decode(lie)


@dataclass
class TaggedPose(Pose):
    frame: str = "map"


class Row(msgspec.Struct, array_like=True):
    first: int


class LongRow(Row, array_like=True):
    second: int = 0


class Sparse(msgspec.Struct, omit_defaults=True, rename="camel", tag=True):
    leg_number: int = 0
    poses: dict[int, Pose] = {}


def test_data_that_would_lose_information_is_refused(approve: Callable[..., None]) -> None:
    def error_text(case: str) -> str:
        kind, value = eval(case)
        with pytest.raises(BadData) as error:
            Format[Any](kind).encode(value)
        return str(error.value)

    approve("refused_data.txt", error_text)


@pytest.mark.parametrize(
    ("kind", "value"),
    [
        (Pose, {"y": 2, "x": 1}),
        (Sparse, {"type": "Sparse", "legNumber": 0, "poses": {1: {"x": 1, "y": 1}}}),
        (dict[int, Sparse], {1: Sparse(0), 2: Sparse(2)}),
        (Options, {}),
        (tuple[set[int], Pose], [[1, 1], POSE]),
        (Scan, {"heights": np.zeros(2, "f4"), "raw": b""}),
        (tuple[Pose, ...], [POSE]),
        (Row, [1]),
    ],
)
def test_data_in_an_equivalent_form_is_encoded(kind: Any, value: Any) -> None:
    Format[Any](kind).encode(value)


@pytest.mark.parametrize(
    "data", [b"", b"\xc1", b"\x91" * 2000, b"\xa2\xff\xff", b"\xc7\x01\x01\x90"]
)
def test_bytes_without_a_valid_value_are_refused(data: bytes) -> None:
    with pytest.raises(BadData):
        Format[Any](Scan).decode(data)


@pytest.mark.parametrize(
    "kind", [Exception, "nonsense", lambda: 1, dict[Pose, int] | list[int] | set[int]]
)
def test_type_without_a_schema_is_refused(kind: Any) -> None:
    with pytest.raises(BadFormat):
        Format[Any](kind)


def test_data_is_decoded_without_its_type() -> None:
    assert decode_untyped(Format[Any](Pose).encode(POSE)) == {"x": 1.0, "y": 2.0, "side": "right"}
    assert decode_untyped(b"") is None


@dataclass
class Position:
    """Another name and other defaults, but the same shape as Pose."""

    x: float
    y: float
    side: Literal["left", "right"] = "right"


@dataclass
class TextPose:
    x: str
    y: float
    side: Side = Side.LEFT


@dataclass
class StrictPose:
    x: float
    y: float
    side: Side


@dataclass
class LongPose:
    x: float
    y: float
    z: float
    side: Side = Side.LEFT


@dataclass
class Branch:
    value: int
    children: "list[Tree]"


def test_formats_are_compared_by_shape(approve: Callable[..., None]) -> None:
    approve("differences.txt", lambda case: first_difference(*map(schema_text, eval(case))))


def test_bad_data_errors_name_the_message() -> None:
    with pytest.raises(BadData, match="goal 'take steps' wants data of type Pose: "):
        Goal("take steps", Pose).encode_data(3)  # type: ignore[arg-type]
    with pytest.raises(BadData, match="the handler of command 'move leg' must return Pose: "):
        Command("move leg", Pose, result=Pose).encode_reply(3)  # type: ignore[arg-type]
    with pytest.raises(BadData, match="query 'where' came with data that is not of type Pose"):
        Query("where", Pose, reply=Pose).decode_data(b"\x01")
    with pytest.raises(BadData, match="failure 'slipped' wants data of type Pose"):
        Failure("slipped", Pose)(1)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["", " ", "x" * 200, "bell\a", 7])
def test_invalid_message_name_is_refused(name: Any) -> None:
    with pytest.raises(BadFormat, match="is not a message name"):
        Goal(name)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ('{"anyOf":5}', '{"anyOf":[3]}'),
        ('{"properties":5}', '{"properties":[1]}'),
        ('{"$ref":5}', '{"$ref":"#/$defs/A"}'),
        ('{"enum":5}', '{"enum":[1]}'),
        ('{"items":' * 2000 + "1" + "}" * 2000, '{"items":' * 2000 + "2" + "}" * 2000),
        ("nonsense", "{}"),
        ("[]", "5"),
        ("", "{}x"),
    ],
)
def test_malformed_schema_does_not_break_the_comparison(one: str, other: str) -> None:
    assert first_difference(one, other)
