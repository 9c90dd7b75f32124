"""The module that answers a monitor's condition dies, or leaves: while it answers, or between two tests."""

import threading

import pytest
from module.real_central import RealCentral, until

from tca_module import Client, Command, ExceptionHandler, Failure, Module, PollingMonitor, Query, Task, connect
from tca_module.testing import LocalCentral
from tca_wire.journal.facts import MonitorTested

pytestmark = pytest.mark.usefixtures("attentive")

BATTERY = Query("battery", reply=bool)
WATCH = PollingMonitor("watch", condition=BATTERY, action=Command("charge"))
SHRUG = ExceptionHandler("shrug")
SLIP = Failure("slip")
MOVE = Command("move")
SOON = 10.0


@pytest.mark.parametrize("is_handled", [True, False])
def test_while_it_answers_that_is_the_monitors_failure(central: LocalCentral, user: Client, is_handled: bool) -> None:
    asked, go_on = threading.Event(), threading.Event()
    gauge, safety, shrugged = Module("gauge", central), Module("safety", central), list[str]()

    @gauge.handles(BATTERY)
    def battery(_: Task) -> bool:
        asked.set()
        return not go_on.wait(SOON)

    safety.handles(SHRUG)(lambda task: shrugged.append(task.trouble.failure))
    with gauge.running(), safety.running():
        if is_handled:
            user.on_failure(None, SHRUG, of=WATCH)
        monitor = user.monitor(WATCH, period=0.05)
        assert asked.wait(SOON)
        central.cut("gauge")
        go_on.set()
        if is_handled:
            until(lambda: any(isinstance(fact, MonitorTested) for fact in central.facts), "it tests on")
            assert shrugged == ["module lost"]
            assert monitor.end()
        else:
            assert monitor.wait(SOON).value == "failed"


def test_between_two_tests_the_next_one_waits_and_centrals_log_says_so(caplog: pytest.LogCaptureFixture) -> None:
    blind = "'watch' sees nothing until somebody handles its condition 'battery'"
    with RealCentral("tcp://127.0.0.1:*") as central, connect("user", central.address) as user:

        def gauge() -> Module:
            gauge = Module("gauge", central.address)
            gauge.handles(BATTERY)(lambda _: False)
            return gauge

        def tests() -> int:
            return len(central.facts(MonitorTested))

        with gauge().running():
            monitor = user.monitor(WATCH, period=0.05)
            until(tests, "it tests")
            assert "sees nothing" not in caplog.text
        until(lambda: f"task {monitor.id} {blind}" in caplog.text, "the log says it")
        assert caplog.text.count("sees nothing") == 1
        before = tests()
        with gauge().running():
            until(lambda: tests() > before, "it tests on")
        assert monitor.end()


def test_centrals_log_names_what_failed(caplog: pytest.LogCaptureFixture) -> None:
    with RealCentral("tcp://127.0.0.1:*") as central, connect("user", central.address) as user:
        legs = Module("legs", central.address)

        @legs.handles(MOVE)
        def move(_: Task) -> None:
            raise SLIP()  # noqa: RSE102 - it is no class

        @legs.handles(BATTERY)
        def battery(_: Task) -> bool:
            raise SLIP(None, "flat")

        with legs.running():
            task = user.command(MOVE)
            task.wait(SOON)
            with pytest.raises(Exception, match="flat"):
                user.query(BATTERY)
        assert f"failure 'slip' of task {task.id} 'move'\n" in caplog.text
        assert f"failure 'slip' of query {task.id + 1} 'battery': flat\n" in caplog.text
