"""Calls that are allowed but almost certainly mistakes cause a warning. A broken log handler ends
no module.
"""

import logging
import time

import pytest
from module.real_central import SOON

from tca_module import (
    Client,
    Command,
    Module,
    Outcome,
    Task,
)
from tca_module.serving import event_loop
from tca_module.testing import LocalCentral

REST = Command("rest")


def test_second_module_of_same_name_is_warned(
    central: LocalCentral, legs: Module, caplog: pytest.LogCaptureFixture
) -> None:
    legs.handles(REST)(lambda _: None)
    with legs.running():
        assert not caplog.messages
        with Module("legs", central).running():
            (warning,) = caplog.messages
    assert "another module 'legs' runs, so central calls this one 'legs#2'" in warning


def test_resource_without_handlers_is_warned_of(
    legs: Module, caplog: pytest.LogCaptureFixture
) -> None:
    for name in ("arm", "hip", "head"):
        legs.resource(name, capacity=2)
    legs.resource("pen")  # a mutex
    legs.handles(REST, resource="hip")(lambda _: None)
    legs.every(100, resource="head")(lambda: None)
    with legs.running():
        assert [warning.partition(" of ")[0] for warning in caplog.messages] == ["resource 'arm'"]


@pytest.mark.parametrize("is_last", [False, True])
def test_blocking_async_handler_is_warned_of_once(
    legs: Module,
    user: Client,
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
    *,
    is_last: bool,
) -> None:
    monkeypatch.setattr(event_loop, "BRIEF", 0.3)

    @legs.handles(REST)
    async def rest(task: Task) -> None:
        time.sleep(0.3)  # noqa: ASYNC251 - the mistake
        if not is_last:
            await task.sleep(0.01)

    with legs.running():
        for _ in range(2):
            assert user.command(REST).wait(SOON) is Outcome.DONE
    (warning,) = caplog.messages
    assert warning.startswith("the async handler of rest has blocked its event loop for 0.")


class RaisingHandler(logging.Handler):
    """A log handler that raises instead of calling ``handleError``."""

    def emit(self, record: logging.LogRecord) -> None:
        raise OSError(f"no room for {record.msg:.20}")


def test_raising_log_handler_does_not_end_module(
    legs: Module, user: Client, capsys: pytest.CaptureFixture[str]
) -> None:
    @legs.handles(REST)
    def rest(_: Task) -> None:
        raise ValueError

    logging.getLogger("tca.legs").addHandler(broken := RaisingHandler())
    with legs.running():
        assert [user.command(REST).wait(SOON) for _ in range(2)] == [Outcome.FAILED, Outcome.FAILED]
    logging.getLogger("tca.legs").removeHandler(broken)
    assert "OSError: no room for handler" in capsys.readouterr().err
