"""mypy finds each mistake in ``mistakes.py`` and no other, with helpful messages. Each mistake has
a ``type: ignore``. Strict mypy reports an unneeded one, so each mistake must be found.
"""

import inspect
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, NewType, Protocol, TypeVar

import numpy as np
import pytest
from numpy.typing import NDArray

import tca_module
from tca_module import (
    Command,
    HandlerOptions,
    MisuseError,
    Module,
    MonitorOptions,
    Task,
    TaskOptions,
)
from tca_module.session.registering import register_headers
from tca_wire.messages.message import Declaring
from tca_wire.packets import codec
from tca_wire.packets.headers import Register
from tca_wire.packets.parts import HandlerFormat, MessageFormat
from tca_wire.vocabulary import Limit, MessageClass

MYPY = shutil.which("mypy", path=str(Path(sys.executable).parent))


@pytest.mark.slow
@pytest.mark.skipif(MYPY is None, reason="mypy is not installed")
def test_type_checker_finds_each_mistake(tmp_path: Path) -> None:
    mistakes = Path(__file__).with_name("mistakes.py")
    bare = tmp_path / "bare.py"
    bare.write_text(re.sub(r"  # type: ignore\S+", "", mistakes.read_text()))
    options = [
        "--config-file",
        "setup.cfg",
        "--follow-imports",
        "silent",
        "--cache-dir",
        os.devnull,
    ]
    command = [sys.executable, "-m", "mypy", *options, str(mistakes), str(bare)]
    found = subprocess.run(
        command, cwd=Path(__file__).parents[2], capture_output=True, text=True, check=False
    )
    assert str(mistakes.name) not in found.stdout, found.stdout
    expected = re.findall(r'of "HandlerDecorator\w*" has .*; expected (.*)  \[', found.stdout)
    assert len(expected) == mistakes.read_text().count("handles(STANCE)  # type") + 1
    assert not [text for text in expected if "Coroutine" in text]
    assert (
        'incompatible type "Command[int, Footfall]"; expected "Command[None, Footfall]"'
        in found.stdout
    )
    assert 'Missing positional argument "data"' in found.stdout


DECLARATIONS = [
    one for name in tca_module.__all__ if isinstance(one := getattr(tca_module, name), Declaring)
]
DECLARATIONS.remove(tca_module.Retry)  # has no name


@pytest.mark.parametrize("kind", DECLARATIONS, ids=lambda kind: kind.__name__)
def test_declaration_signature_shows_its_arguments(kind: Any) -> None:
    arguments = inspect.signature(kind).parameters
    assert list(arguments)[:2] == ["name", "data"]
    assert not {"VAR_POSITIONAL", "VAR_KEYWORD"} & {one.kind.name for one in arguments.values()}


@pytest.mark.parametrize(
    "kind", [HandlerOptions, MonitorOptions, TaskOptions], ids=lambda kind: kind.__name__
)
def test_docstring_names_each_option(kind: Any) -> None:
    _, _, described = kind.__doc__.partition("Args:")
    assert [
        name for name in kind.__annotations__ if not re.search(rf"\b{name}[:,]", described)
    ] == []


# --- A handler's data annotation must fit its message ---------------------------------------------


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
    (int, float),
    (float, object),
    (float, Any),
    (float, "Unknown"),
    (float, T),
    (Pose3, Pose),
    (Pose, HasX),
    (float, Metres),
    (Annotated[float, "m"], float),
    (list[int], Sequence[float]),
    (dict[str, int], Mapping[str, Any]),
    (float | None, float | str | None),
    (Literal["a", "b"], str),
    (tuple[int, ...], tuple[int, int]),
    (NDArray[np.float64], np.ndarray),
    (Sequence[int], list[int]),
    (list[Pose3], list[Pose]),
]
WRONG = [
    (float, int),
    (Pose, Pose3),
    (list[int], list[str]),
    (float, str | None),
    (float | None, float),
    (Pose, dict),
    (NDArray[np.float64], NDArray[np.float32]),
    (dict[str, int], Mapping[int, int]),
    (int, Pose),
]


@pytest.mark.parametrize(
    ("kind", "hint", "fits"),
    [*((*pair, True) for pair in RIGHT), *((*pair, False) for pair in WRONG)],
)
def test_unfitting_data_annotation_is_refused(kind: Any, hint: Any, *, fits: bool) -> None:
    def handler(_: Task, data: Any) -> None: ...

    handler.__annotations__["data"] = hint
    with (
        nullcontext()
        if fits
        else pytest.raises(MisuseError, match=r"handler takes data: .* has data of type")
    ):
        Module("legs").handles(Command("move", kind))(handler)


# --- Declarations are divided into requests that central accepts in order -------------------------


@pytest.mark.parametrize(
    ("number", "size", "expected"), [(0, 0, 1), (500, 40, 1), (1200, 40, 6), (9, 200_000, 6)]
)
def test_any_number_of_declarations_is_accepted(number: int, size: int, expected: int) -> None:
    messages = [MessageFormat(f"m{one}", MessageClass.INFORM, "x" * size) for one in range(number)]
    handlers = [HandlerFormat(message.name, "r") for message in messages] if expected > 1 else []
    found = register_headers(messages, handlers, is_ready=True)
    assert len(found) == expected
    assert [message for one in found for message in one.messages] == messages
    assert [handled for one in found for handled in one.handlers] == handlers
    assert [one.is_ready for one in found] == [False] * (expected - 1) + [True]
    declared: set[str] = set()
    for one in found:
        declared |= {message.name for message in one.messages}
        assert {handled.message for handled in one.handlers} <= declared
    packets = codec.packets([(one, b"") for one in found])
    taken = [header for _, packet in packets for header, _ in codec.unpack_to_central(packet)]
    assert taken == found
    assert all(isinstance(one, Register) and len(one.messages) <= Limit.LIST for one in taken)
