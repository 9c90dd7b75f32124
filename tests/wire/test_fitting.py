"""The comparison of two formats predicts whether data can be decoded."""

import functools
import itertools
import json
import uuid
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import Annotated, Any, Literal, NamedTuple, TypedDict

import msgspec
import numpy as np
import pytest

from tca_wire.errors import BadData
from tca_wire.messages.fitting import first_misfit
from tca_wire.messages.formats import Format
from tca_wire.messages.schemas import schema_text


class Side(Enum):
    LEFT = "left"
    RIGHT = "right"


class Gait(IntEnum):
    TRIPOD = 1
    WAVE = 2


@dataclass
class Contact:
    leg: int
    height: float


@dataclass
class Scraped(Contact):
    """A subclass with one more field."""

    side: Side


@dataclass
class Touch:
    """A class with another name but the same fields."""

    leg: int
    height: float


@dataclass
class Nested:
    contact: Contact
    before: list[Contact]


@dataclass
class NestedScraped:
    contact: Scraped
    before: list[Scraped]


@dataclass
class Named:
    leg: str
    height: float


class Exact(msgspec.Struct, forbid_unknown_fields=True):
    leg: int
    height: float


class Slip(msgspec.Struct, tag="slip"):
    by: float


class Fall(msgspec.Struct, tag="fall"):
    height: float


class Pair(NamedTuple):
    leg: int
    height: float


class Row(msgspec.Struct, array_like=True):
    leg: int
    height: float


class Sparse(TypedDict, total=False):
    leg: int


class Leg(msgspec.Struct):
    leg: int


@dataclass
class Tree:
    value: int
    children: "list[Tree]"


@dataclass
class Branch:
    value: float
    children: "list[Branch]"
    tag: str | None = None


@dataclass
class TextTree:
    value: str
    children: "list[TextTree]"


CONTACT, SCRAPED = Contact(1, 0.5), Scraped(2, 0.25, Side.LEFT)

# Each type has a value for each of its alternatives. A format that fits all values fits the type.
TYPES: list[tuple[Any, list[Any]]] = [
    (None, [None]),
    (int, [1, -50, 50]),
    (float, [0.5]),
    (bool, [True]),
    (str, ["rock"]),
    (bytes, [b"rock"]),
    (uuid.UUID, [uuid.UUID(int=7)]),
    (int | None, [1, -50, 50, None]),
    (float | None, [0.5, None]),
    (int | str, [1, -50, "rock"]),
    (int | str | None, [1, "rock", None]),
    (Side, [Side.LEFT, Side.RIGHT]),
    (Gait, [Gait.TRIPOD, Gait.WAVE]),
    (Literal["left"], ["left"]),
    (Literal["left", 1], ["left", 1]),
    (Literal["left", "right", "both"], ["left", "right", "both"]),
    (Literal["left", "up"] | float, ["left", "up", 0.5]),
    (Annotated[int, msgspec.Meta(ge=0)], [0, 50]),
    (Annotated[int, msgspec.Meta(ge=-7, le=9)], [-7, 9]),
    (Annotated[str, msgspec.Meta(min_length=50)], ["rock" * 20]),
    (Contact, [CONTACT]),
    (Scraped, [SCRAPED]),
    (Touch, [Touch(1, 0.5)]),
    (Named, [Named("one", 0.5)]),
    (Exact, [Exact(1, 0.5)]),
    (Contact | None, [CONTACT, None]),
    (Scraped | None, [SCRAPED, None]),
    (Slip | Fall, [Slip(0.1), Fall(2.0)]),
    (Fall, [Fall(2.0)]),
    (Nested, [Nested(CONTACT, [CONTACT])]),
    (NestedScraped, [NestedScraped(SCRAPED, [SCRAPED])]),
    (Tree, [Tree(1, [Tree(2, [])])]),
    (Branch, [Branch(0.5, [Branch(1.5, [], "twig")])]),
    (TextTree, [TextTree("a", [])]),
    (Sparse, [{}, {"leg": 1}]),
    (dict[str, int], [{"hip": 1}, {"leg": 1}, {}]),
    (dict[str, float | None], [{"hip": 0.5}, {"leg": None}, {}]),
    (list[int], [[], [1], [1, 2, 3]]),
    (list[float], [[], [0.5], [1.5, 2.5, 3.5]]),
    (list[int | None], [[], [None], [1, None, 3]]),
    (set[int], [set(), {1, 2, 3}]),
    (tuple[int, float], [(1, 0.5)]),
    (tuple[int, str], [(1, "rock")]),
    (tuple[int, ...], [(), (1,), (1, 2, 3)]),
    (tuple[int, int], [(1, 2)]),
    (Pair, [Pair(1, 0.5)]),
    (Row, [Row(1, 0.5)]),
    (list[Contact], [[CONTACT]]),
    (list[Scraped], [[SCRAPED], []]),
    (list[Contact | None], [[CONTACT], [None]]),
    (np.ndarray, [np.zeros(3)]),
]


@functools.cache
def formats() -> list[Format[Any]]:
    return [Format[Any](kind(one)) for one, _ in TYPES]


def reads(values: list[Any], sent: Format[Any], wanted: Format[Any]) -> bool:
    """Whether all *values* can be decoded after their delivery."""
    try:
        for value in values:
            wanted.decode(sent.encode(value))
    except BadData:
        return False
    return True


def kind(one: Any) -> Any:
    return type(None) if one is None else one


@pytest.mark.parametrize("place", range(len(TYPES)), ids=lambda place: str(TYPES[place][0]))
def test_misfit_predicts_whether_data_can_be_decoded(place: int) -> None:
    (sent, values), written = TYPES[place], formats()[place]
    for (wanted, _), read in zip(TYPES, formats(), strict=True):
        if wanted is Fall and sent is not Fall:
            continue  # a receiver supplies a missing tag, so such values decode nevertheless
        misfit = first_misfit(written.schema, read.schema)
        assert (misfit is None) == reads(values, written, read), f"{sent} to {wanted}: {misfit}"


@pytest.mark.parametrize(("one", "_values"), TYPES, ids=str)
def test_any_type_fits_every_format(one: Any, _values: list[Any]) -> None:
    for each in itertools.permutations((schema_text(kind(one)), schema_text(Any))):
        assert first_misfit(*each) is None
    assert first_misfit(schema_text(list[Any]), schema_text(list[int])) is None
    assert first_misfit(schema_text(dict[str, Any]), schema_text(dict[str, int])) is None


def test_misfit_names_the_path_and_the_wanted_type(approve: Callable[..., None]) -> None:
    approve(
        "misfits.txt", lambda case: first_misfit(*(schema_text(kind(one)) for one in eval(case)))
    )


def test_optional_field_does_not_fit_a_required_one() -> None:
    """A format does not tell whether the sender really leaves out an optional field."""
    assert (
        first_misfit(schema_text(Sparse), schema_text(Leg))
        == "$.leg: required here, optional there"
    )


def a_type(**fields: str) -> dict[str, Any]:
    of = {
        name: {"$ref": f"#/$defs/{kind}"} if kind.isupper() else {"type": kind}
        for name, kind in fields.items()
    }
    return {"type": "object", "properties": of, "required": list(fields)}


def test_assumption_of_a_failed_alternative_is_discarded() -> None:
    """U fits V only if T fits X. T does not fit X, so T does not fit W either."""
    sent = {"$ref": "#/$defs/T", "$defs": {"T": a_type(a="U", z="string"), "U": a_type(b="T")}}
    defs: dict[str, Any] = {
        "X": a_type(a="V", z="integer"),
        "V": a_type(b="X"),
        "W": a_type(a="V", z="string"),
    }
    for names in itertools.permutations("XW"):
        wanted = {"anyOf": [{"$ref": f"#/$defs/{name}"} for name in names], "$defs": defs}
        assert first_misfit(
            json.dumps(sent), json.dumps(wanted)
        ) == "$: X or W here, object there".replace("X or W", " or ".join(names))
    defs["V"] = a_type(b="W")
    assert first_misfit(json.dumps(sent), json.dumps({"$ref": "#/$defs/W", "$defs": defs})) is None


@pytest.mark.parametrize(
    "nonsense",
    ["", "{", "5", "[]", '{"anyOf":5}', '{"$ref":"#/$defs/A"}', '{"type":"array","prefixItems":5}'],
)
def test_malformed_schema_does_not_break_the_comparison(nonsense: str) -> None:
    for other in (schema_text(tuple[int, int]), '{"items":' * 2000 + "1" + "}" * 2000):
        for one in itertools.permutations((nonsense, other)):
            first_misfit(*one)
