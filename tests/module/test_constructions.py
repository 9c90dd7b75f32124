"""Whoever constructs a public class wrongly is told so in terms of what can be imported."""

import re
from collections.abc import Iterator
from typing import Any

import pytest

import tca_explorer
import tca_module
from tca_module.testing import LocalCentral

PUBLIC: dict[str, type] = {
    f"{package.__name__}.{name}": thing
    for package in (tca_module, tca_explorer)
    for name in package.__all__
    if isinstance(thing := getattr(package, name), type)
} | {"tca_module.testing.LocalCentral": LocalCentral}

WRITTEN = [
    tca_module.Goal, tca_module.Command, tca_module.Query, tca_module.MultiQuery, tca_module.Inform,
    tca_module.Broadcast, tca_module.Variable, tca_module.ExceptionHandler, tca_module.PointMonitor,
    tca_module.PollingMonitor, tca_module.DemonMonitor, tca_module.Failure, tca_module.Module, LocalCentral,
    tca_explorer.Scenario, tca_explorer.Property,
]  # fmt: skip
"""What users write themselves."""

WRONG: list[tuple[tuple[Any, ...], dict[str, Any]]] = [
    ((), {}),
    (("x",), {}),
    ((), {"nonsense": 1}),
    (("x",), {"nonsense": 1}),
    ((1,) * 20, {}),
    ((None, None), {}),
]


def errors_of(kind: Any) -> Iterator[str]:
    for arguments, options in WRONG:
        try:
            kind(*arguments, **options)
        except Exception as error:  # noqa: BLE001 - whatever it is: it is the text that matters
            yield str(error)


@pytest.mark.parametrize("kind", PUBLIC.values(), ids=PUBLIC)
def test_no_error_of_a_construction_names_what_is_private(kind: type) -> None:
    for text in errors_of(kind):
        assert not re.search(r"(?<![\w.])_[A-Za-z]\w*", text.replace("__init__", "").replace("__new__", "")), text


@pytest.mark.parametrize("kind", WRITTEN, ids=lambda kind: kind.__name__)
def test_what_users_write_names_itself_and_the_argument(kind: Any) -> None:
    with pytest.raises(
        TypeError, match=rf"^{kind.__name__}\.__init__\(\) got an unexpected keyword argument 'nonsense'"
    ):
        kind("x", nonsense=1)
    if kind is not LocalCentral:
        with pytest.raises(TypeError, match=rf"^{kind.__name__}\.__init__\(\) missing \d required .*: '"):
            kind()


@pytest.mark.parametrize("kind", [tca_module.PointMonitor, tca_module.PollingMonitor])
def test_a_monitor_without_its_condition(kind: Any) -> None:
    with pytest.raises(TypeError, match=rf"^{kind.__name__}\.__init__\(\) missing .* argument: 'condition'$"):
        kind("q", action=tca_module.Command("no"))
