"""All that users may hand to another process can be pickled and copied; all that hangs on a connection says no."""

import copy
import importlib
import inspect
import multiprocessing
import pickle
import pkgutil
from collections.abc import Callable, Iterator
from typing import Any

import pytest

import tca_module
from tca_missions.outcomes import Status, TaskEnd
from tca_module import Client, Command, DemonMonitor, Failure, MisuseError, Module, Task
from tca_module.errors import TaskFailed
from tca_wire.vocabulary import Refusal

PACKAGES = ("tca_wire", "tca_module", "tca_missions", "tca_coordination", "tca_activities")
OTHERS = ("tca_central.errors", "tca_tools.errors", "tca_explorer.errors")

BOUNCED = Failure("bounced", list[int])
MOVE = Command("move", list[int], result=float, progress=dict[str, int])

ARGUMENTS: dict[str, tuple[Any, ...]] = {
    "Refused": ("walk", Refusal.OVERLOAD, "too many"), "FormatRefused": ("walk", Refusal.FORMAT, "others differ"),
    "Deadlock": ("walk", Refusal.DEADLOCK, "a circle"), "NotSent": (3, "3 messages"), "Timeout": ("no reply",),
    "RequestFailed": ("walk", "fell", "over", b"\x01"), "QueryFailed": ("walk", "fell", "over", b"\x01"),
    "TaskFailed": ("walk {2}", "fell", "over\na traceback", b"\x93\x01\x02\x03"), "Rejected": ("walk", "no leg"),
    "TaskKilled": ("walk", "by hand"), "Aborted": ("walk", "by hand"), "RequestError": (Refusal.TOO_LATE, "it ended"),
    "FailureRaised": ("fell", "over", b"\x01", ["stopped"]), "FieldMisfit": ("a.b", "is missing"),
    "MissionTaskFailed": ("drive", TaskEnd(Status.TIMEOUT, "slow"), "timeout"), "ConditionVerified": (["low", "far"],),
    "StepUncertain": ("grasp", [("move", "done")]), "NoCentral": ("central is away",),
}  # fmt: skip
"""By class, what its constructor takes if that is not one text."""


def pickled(one: Any) -> Any:
    return pickle.loads(pickle.dumps(one))


def error_classes() -> Iterator[type[BaseException]]:
    names = [one.name for package in PACKAGES for one in pkgutil.walk_packages(
        importlib.import_module(package).__path__, f"{package}.")]  # fmt: skip
    for name in (*names, *OTHERS):
        if not name.endswith("__main__"):
            for kind in vars(importlib.import_module(name)).values():
                if inspect.isclass(kind) and issubclass(kind, BaseException) and kind.__module__ == name:
                    yield kind


@pytest.mark.parametrize("copied", [pickled, copy.copy, copy.deepcopy])
def test_every_error_is_the_same_when_copied(copied: Callable[[Any], Any]) -> None:
    kinds = list(error_classes())
    assert set(ARGUMENTS) <= {kind.__name__ for kind in kinds}
    for kind in kinds:
        error = kind(*ARGUMENTS.get(kind.__name__, ("what was wrong",)))
        error.add_note("a note")
        found = copied(error)
        assert type(found) is kind
        assert (str(found), found.args, vars(found)) == (str(error), error.args, vars(error))
        assert getattr(found, "code", None) == getattr(error, "code", None)


def fails(_: int) -> None:
    raise TaskFailed("walk {2}", "fell", "over", b"\x01")


def test_an_error_of_a_pools_worker_arrives() -> None:
    with multiprocessing.get_context("forkserver").Pool(1) as pool, pytest.raises(TaskFailed) as caught:
        pool.apply_async(fails, (1,)).get(30)
    assert (caught.value.failure, caught.value.data) == ("fell", 1)


@pytest.mark.parametrize("copied", [pickled, copy.deepcopy])
def test_declarations_can_be_copied(copied: Callable[[Any], Any]) -> None:
    monitor = copied(DemonMonitor("rocks", action=MOVE))
    move, bounced = copied(MOVE), copied(BOUNCED)
    assert (move.format, monitor.action.format) == (MOVE.format, MOVE.format)
    assert move.encode_data([1]) == MOVE.encode_data([1])
    assert bounced([1]).body == BOUNCED([1]).body
    assert copied(tca_module.GENERAL) == tca_module.GENERAL


def test_handles_say_that_they_cannot_be_pickled(legs: Module, user: Client) -> None:
    shown: list[str] = []

    @legs.handles(MOVE)
    def move(task: Task, _: list[int]) -> float:
        for one in (task, task.ref, user):
            with pytest.raises(MisuseError, match="can't be pickled or copied: send a task's id"):
                pickle.dumps(one)
        point, number = pickled((task.achieving.end, task.id))
        assert (point, number, vars(number)) == (task.achieving.end, task.id, vars(task.id))
        shown.append("all")
        return 1.0

    with legs.running():
        sent = user.command(MOVE, [1])
        assert pickled(sent.id) == sent.id
        with pytest.raises(MisuseError):
            copy.deepcopy(sent)
        assert sent.result(10) == 1.0
    assert shown
