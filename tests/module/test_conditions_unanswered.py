"""The module that answers a monitor's condition dies, or leaves: while it answers, or between two tests."""

import pytest
from module.real_central import RealCentral, until

from tca_module import Command, Module, PollingMonitor, Query, connect
from tca_wire.journal.facts import MonitorTested

pytestmark = pytest.mark.usefixtures("attentive")

BATTERY = Query("battery", reply=bool)
WATCH = PollingMonitor("watch", condition=BATTERY, action=Command("charge"))


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
