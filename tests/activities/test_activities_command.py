"""``tca activities``: the application that it selects, and its errors."""

import threading
import time
from contextlib import ExitStack
from pathlib import Path

import pytest
from activities.joint import Joint
from click.testing import CliRunner
from processes import central

from tca_behaviours.activities import Application
from tca_behaviours.activities.manager import ApplicationMessages, Manager
from tca_behaviours.activities.page import live as page
from tca_behaviours.activities.page.command import activities
from tca_behaviours.activities.page.live import LiveApplication
from tca_module import Module, connect


def command_error(address: str, *arguments: str) -> str:
    """Return the output of a command that starts no page."""
    result = CliRunner().invoke(activities, [*arguments, "--central", address, "--no-browser"])
    assert result.exit_code == 1
    return result.output.strip()


@pytest.mark.slow
def test_activities_command_finds_or_asks_for_the_application(tmp_path: Path) -> None:
    with central(tmp_path, "--quiet") as daemon:
        assert (
            command_error(daemon.address)
            == "Error: central knows no application: start a program that has a Manager"
        )
        module = Module("robot", daemon.address)
        for name in ("arm", "base"):
            Manager(Application(name)).handle_in(module)
        with module.running():
            assert command_error(daemon.address).endswith(
                "several applications: name one of 'arm', 'base'"
            )
            assert command_error(daemon.address, "leg").endswith(
                "no application 'leg': it knows 'arm', 'base'"
            )
            assert "can't serve on 192.0.2.1:0" in command_error(
                daemon.address, "arm", "--host", "192.0.2.1"
            )
    assert "does not answer" in command_error(daemon.address)


def wait_for_part(live: LiveApplication, part: str, words: str) -> None:
    """Wait until the newest value of a part contains some words."""
    since, end = 0, time.monotonic() + 30
    while time.monotonic() < end:
        news = live.changes_since(since, 1.0)
        since = news["serial"]
        if words in str(news["parts"].get(part)):
            return
    raise AssertionError(words)


@pytest.mark.slow
def test_page_shows_lost_central_and_new_central_gets_all_state(
    tmp_path: Path,
) -> None:
    address, names = f"ipc://{tmp_path}/central.sock", ApplicationMessages("arm")
    module, live = Module("robot", address), LiveApplication("arm", address)
    Manager(Application("arm", [Joint()])).handle_in(module)
    with ExitStack() as robot:
        with central(tmp_path / "first", "--quiet", bind=address):
            robot.enter_context(module.running())
            robot.enter_context(live.running())
            wait_for_part(live, "application", "referencing")
        wait_for_part(live, "lost", "does not answer")
        with (
            central(tmp_path / "second", "--quiet", bind=address),
            connect("user", address) as user,
        ):
            end = time.monotonic() + 30
            while user.get_variable(names.states, None) is None:
                assert time.monotonic() < end
                time.sleep(0.1)
            assert user.get_variable(names.states).states.keys() == {
                "x.limits",
                "x.referencing",
                "x.enabling",
                "x.movement",
            }
            robot.close()


@pytest.mark.slow
def test_page_shows_that_an_application_is_stalled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Here the program hangs while it draws a picture. A stopped program (SIGSTOP) is equally
    silent.
    """
    monkeypatch.setattr(page, "SILENCE", 2.5)
    drawing, is_drawn = threading.Event(), threading.Event()

    def draw() -> str:
        if drawing.is_set():
            is_drawn.wait(60)
        return "<svg/>"

    with central(tmp_path, "--quiet") as daemon:
        module, live = Module("robot", daemon.address), LiveApplication("arm", daemon.address)
        Manager(Application("arm", [Joint()]), picture=draw).handle_in(module)
        with module.running(), live.running():
            wait_for_part(live, "application", "referencing")
            drawing.set()
            wait_for_part(
                live,
                "lost",
                "'arm' has sent no report for more than 2.5 s: its program hangs or is delayed",
            )
            is_drawn.set()
            end = time.monotonic() + 30
            while live.changes_since(0, 0.0)["parts"]["lost"]:
                assert time.monotonic() < end
                time.sleep(0.05)
