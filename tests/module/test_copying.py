"""Values that users may hand to another process can be pickled and copied. Objects that need a
connection refuse to be.
"""

import copy
import importlib
import inspect
import pickle
import pkgutil
from collections.abc import Callable, Iterator
from typing import Any, get_type_hints

import pytest

import tca_module
from tca_behaviours.missions.outcomes import Status, TaskEnd
from tca_central.loading import is_compiled
from tca_module import Client, Command, DemonMonitor, Failure, MisuseError, Module, Task
from tca_wire.vocabulary import Refusal

PACKAGES = (
    "tca_wire",
    "tca_module",
    "tca_behaviours.missions",
    "tca_behaviours.coordination",
    "tca_behaviours.activities",
)
OTHERS = (
    "tca_tools.errors",
    "tca_tools.explore.errors",
    *["tca_central.errors"] * (not is_compiled()),
)
"""Further modules with errors. In a compiled central the errors are left out, because their
constructors do not show their arguments.
"""
VALUES = {
    int: 3,
    bytes: b"\x01",
    Refusal: Refusal.OVERLOAD,
    TaskEnd: TaskEnd(Status.TIMEOUT, "slow"),
}

BOUNCED = Failure("bounced", list[int])
MOVE = Command("move", list[int], result=float, progress=dict[str, int])


def pickled(one: Any) -> Any:
    return pickle.loads(pickle.dumps(one))


def error_classes() -> Iterator[type[BaseException]]:
    packages = [importlib.import_module(name) for name in PACKAGES]
    found = [pkgutil.walk_packages(one.__path__, f"{one.__name__}.") for one in packages]
    for name in (
        *OTHERS,
        *(one.name for some in found for one in some if not one.name.endswith("__main__")),
    ):
        for kind in vars(importlib.import_module(name)).values():
            if (
                inspect.isclass(kind)
                and issubclass(kind, BaseException)
                and kind.__module__ == name
            ):
                yield kind


def make_error(kind: type[BaseException]) -> BaseException:
    """Return an error with arguments of the types that its constructor declares."""
    if not inspect.isfunction(kind.__init__):
        return kind("what was wrong")
    hints = [
        hint
        for name, hint in get_type_hints(kind.__init__).items()
        if name not in ("return", "can_wait")
    ]
    return kind(*(VALUES.get(hint, [] if "Sequence" in str(hint) else "text") for hint in hints))


@pytest.mark.parametrize("copied", [pickled, copy.copy, copy.deepcopy])
def test_every_error_survives_copying(copied: Callable[[Any], Any]) -> None:
    for kind in error_classes():
        error = make_error(kind)
        error.add_note("a note")
        found = copied(error)
        assert (type(found), str(found), found.args, vars(found)) == (
            kind,
            str(error),
            error.args,
            vars(error),
        )
        assert getattr(found, "code", None) == getattr(error, "code", None)


@pytest.mark.parametrize("copied", [pickled, copy.deepcopy])
def test_declarations_can_be_copied(copied: Callable[[Any], Any]) -> None:
    move, monitor = copied(MOVE), copied(DemonMonitor("rocks", action=MOVE))
    assert (move.format, monitor.action.format) == (MOVE.format, MOVE.format)
    assert (move.encode_data([1]), copied(BOUNCED)([1]).body) == (
        MOVE.encode_data([1]),
        BOUNCED([1]).body,
    )
    assert copied(tca_module.GENERAL) == tca_module.GENERAL


def test_pickling_connected_object_is_misuse(legs: Module, user: Client) -> None:
    @legs.handles(MOVE)
    def move(task: Task, _: list[int]) -> float:
        for one in (task, task.ref, user):
            with pytest.raises(MisuseError, match="can't be pickled or copied: send a task's id"):
                pickle.dumps(one)
        assert pickled((task.achieving.end, task.id)) == (task.achieving.end, task.id)
        return 1.0

    with legs.running():
        sent = user.command(MOVE, [1])
        with pytest.raises(MisuseError):
            copy.deepcopy(sent)
        assert sent.result(10) == 1.0
        assert vars(pickled(sent.id)) == vars(sent.id)
