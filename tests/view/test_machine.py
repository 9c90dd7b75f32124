"""A state machine of tasks on the page: its picture with the active states at the time shown."""

import json
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest
from playwright.sync_api import Page, expect
from tools.story import Story

from tca_behaviours.missions.charts import Sequence
from tca_module import Command
from tca_wire.charts import ActiveStates, ChartState, MachineChart, StateKind
from tca_wire.journal import facts
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import MessageClass, Party
from view.conftest import OpenPage, until

pytestmark = pytest.mark.slow

MACHINE, OTHER, LARGE = TaskId(1), TaskId(2), TaskId(3)


@pytest.fixture
def patrol(tmp_path: Path) -> Path:
    """Return a machine that enters states at 2 s and 4 s, and ends at 6 s."""
    with Sequence("patrol") as sm:
        sm.Wait(duration=1.0)
        with sm.concurrence():
            sm.Look(foreground=False)
            sm.GoTo()
    parts = [ChartState(f"{number}", StateKind.TASK, 0) for number in range(200)]
    large = MachineChart("large", [ChartState("large", StateKind.SEQUENCE, -1), *parts])
    story = Story().module("patrol", "patrol", "large").module("arm", "grasp")
    for name in ("patrol", "large"):
        data = Command(name, MachineChart).data.schema
        story.say(facts.FormatDefined(name, MessageClass.COMMAND, data, "", "patrol"))
    story.at(1.0).command("patrol", "user", to="patrol", data=sm.chart)
    story.command("grasp", "user", to="arm", data={"width": 1})
    story.command("large", "user", to="patrol", data=large)
    for time, serial, running, active in (
        (2.0, 2, ["Wait"], [0, 1]),
        (4.0, 3, ["Look", "GoTo"], [0, 2, 3, 4, 99]),
    ):
        states = msgspec.msgpack.encode(ActiveStates(running, "", active))
        story.at(time).say(
            facts.StateChanged(
                MACHINE, "result available", "running", serial, Party.SERVER, "patrol", "", states
            )
        )
    story.at(6.0).returned(MACHINE).reached(MACHINE, Moment.END_ACHIEVING).at(7.0)
    return story.write(tmp_path / "patrol")


def active(page: Page) -> Any:
    """Return the first lines of the active states."""
    page.wait_for_selector(".machine svg")
    return page.evaluate(
        "() => [...document.querySelectorAll('.machine .active')].map((one) => one.querySelector('text').textContent).sort().join(' ')"
    )


def test_active_states_follow_the_shown_time(open_page: OpenPage, patrol: Path) -> None:
    page = open_page(patrol, "#t=2&task=1")
    assert active(page) == "Wait patrol"
    picture = page.locator(".machine svg").element_handle()
    for time, expected in (
        (1.5, ""),
        (4.5, "GoTo Look concurrence patrol"),
        (2.5, "Wait patrol"),
        (7, ""),
    ):
        page.evaluate("(time) => { location.hash = `#t=${time}&task=1`; }", time)
        until(
            page,
            "(expected) => [...document.querySelectorAll('.machine .active text:first-of-type')].map((one) => one.textContent).sort().join(' ') === expected",
            expected,
        )
    assert picture.evaluate("(one) => one.isConnected")  # not drawn again
    page.locator(".machine").click()
    expect(page.locator(".machine")).to_have_class("machine whole")
    page.evaluate("() => { location.hash = '#t=5&task=2'; }")
    expect(page.locator("#task h2")).to_have_text("grasp {2}")
    expect(page.locator(".machine")).to_have_count(0)
    page.evaluate("() => { location.hash = '#t=5&task=3'; }")
    expect(page.locator(".machine")).to_have_text("201 states are too many for a picture")


def test_server_serves_machine_pictures_of_machines_only(
    serve: Callable[[Path], str], patrol: Path
) -> None:
    address = serve(patrol)

    def asked(what: str) -> Any:
        with urllib.request.urlopen(f"{address}api/{what}", timeout=20) as answer:
            return json.loads(answer.read())

    asked_svg = asked("machine/1")["svg"]
    assert "state&#45;4" in asked_svg or "state-4" in asked_svg
    assert asked("message/1?at=4.5")["machine"] == {"active": [0, 2, 3, 4]}
    assert "machine" not in asked("message/2")
    for nothing in ("machine/2", "machine/77"):
        with pytest.raises(urllib.error.HTTPError, match="404"):
            asked(nothing)


def test_server_finds_a_message_while_it_reads(
    serve: Callable[[Path], str], tmp_path: Path
) -> None:
    """The server reads 2,000 entries at a time. It must not refuse messages of later entries."""
    story = Story().module("arm", "grasp")
    for number in range(1, 4001):
        story.at(number / 1000).command("grasp", "user", to="arm", data={"width": 1})
    address = serve(story.write(tmp_path / "long"))
    with urllib.request.urlopen(f"{address}api/message/4000", timeout=20) as answer:
        assert answer.status == 200
