"""Central is killed and absent for longer than any patience. After its restart, central gets all
changes.
"""

import logging
import threading
import time
from pathlib import Path

import pytest
from activities.joint import Joint
from processes import Central

from tca_behaviours.activities import Application, VirtualBaton, one_each
from tca_behaviours.activities.central_ports import publish
from tca_behaviours.activities.manager import ApplicationMessages, Manager
from tca_behaviours.activities.page.live import LiveApplication, PageCommand
from tca_module import Callback, CentralLost, Module, Variable, connect

NAMES, POSITION, OTHER = (
    ApplicationMessages("robot"),
    Variable("position of x", float),
    Variable("other", int),
)


def test_changes_during_central_downtime_are_published_later(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    joint, baton, losses = Joint(), VirtualBaton(), threading.Semaphore(0)
    application = Application("robot", [joint], baton=baton)
    central = Central(tmp_path)
    module = Module("robot", central.address)
    Manager(application).handle_in(module)
    publish(module, joint.position, POSITION)

    @module.every(0.05, resource=module.resource("other"))
    def set_other(callback: Callback) -> None:
        try:
            callback.set_variable(OTHER, 1)
        except CentralLost:
            losses.release()

    with module.running(patience=0.2), application.running():
        central.kill()
        joint.command.put("enable")
        baton.run(0.1)
        application.allocate(one_each)
        joint.position.set(0.7)
        for _ in range(3):  # by then every patience is over
            assert losses.acquire(timeout=60)
        central = Central(tmp_path)
        try:
            with connect("user", central.address, patience=20) as user:
                until = time.monotonic() + 60
                while not (
                    user.get_variable(NAMES.allocation).policy == "one_each"
                    and user.get_variable(NAMES.states).states["x.enabling"] == "enabled"
                    and user.get_variable(POSITION, 0.0) == 0.7
                ):
                    assert time.monotonic() < until
                    time.sleep(0.05)
                changes = user.get_variable(NAMES.states).changes
        finally:
            central.stop()
    assert (changes[-1].region, changes[-1].target) == ("enabling", "enabled")
    assert not [one for one in caplog.records if one.levelno >= logging.ERROR]


@pytest.mark.soak
def test_page_command_works_at_once_after_central_restart(tmp_path: Path) -> None:
    """The page had given up its connection, so central need not wait for the page."""
    central = Central(tmp_path)
    module, live = Module("robot", central.address), LiveApplication("robot", central.address)
    Manager(Application("robot", [Joint()], baton=VirtualBaton())).handle_in(module)

    def until_lost(*, is_lost: bool) -> None:
        until = time.monotonic() + 60
        while bool(live.changes_since(0, 0.0)["parts"].get("lost", not is_lost)) is not is_lost:
            assert time.monotonic() < until
            time.sleep(0.05)

    with module.running(), live.running():
        until_lost(is_lost=False)
        central.kill()
        until_lost(is_lost=True)
        central = Central(tmp_path)
        until_lost(is_lost=False)
        reply = live.send(PageCommand("set policy of robot", "one_each"))
        log_text = central.stop()
    assert reply == "set policy of robot: done"
    assert "did not come back" not in log_text
