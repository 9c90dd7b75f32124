"""A handler whose data are annotated with another type than its message's is refused where it is declared."""

from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from typing import Annotated, Any, Literal, NewType, Protocol, TypeVar

import numpy as np
import pytest
from numpy.typing import NDArray

from tca_module import Command, MisuseError, Module, Task

T = TypeVar("T")
Metres = NewType("Metres", float)


@dataclass
class Pose:
    x: float


@dataclass
class Pose3(Pose):
    z: float


class HasX(Protocol):
    x: float


RIGHT = [
    (int, float), (float, object), (float, Any), (float, "Unknown"), (float, T), (Pose3, Pose), (Pose, HasX),
    (float, Metres), (Annotated[float, "m"], float), (list[int], Sequence[float]), (dict[str, int], Mapping[str, Any]),
    (float | None, float | str | None), (Literal["a", "b"], str), (tuple[int, ...], tuple[int, int]),
    (NDArray[np.float64], np.ndarray), (Sequence[int], list[int]), (list[Pose3], list[Pose]),
]  # fmt: skip
WRONG = [
    (float, int), (Pose, Pose3), (list[int], list[str]), (float, str | None), (float | None, float), (Pose, dict),
    (NDArray[np.float64], NDArray[np.float32]), (dict[str, int], Mapping[int, int]), (int, Pose),
]  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "hint", "fits"), [*((*pair, True) for pair in RIGHT), *((*pair, False) for pair in WRONG)]
)
def test_an_annotation_of_data_that_never_fits_is_refused(kind: Any, hint: Any, *, fits: bool) -> None:
    def handler(_: Task, data: Any) -> None: ...

    handler.__annotations__["data"] = hint
    with nullcontext() if fits else pytest.raises(MisuseError, match=r"handler takes data: .* has data of type"):
        Module("legs").handles(Command("move", kind))(handler)
