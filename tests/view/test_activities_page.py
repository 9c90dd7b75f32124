"""The page of an application: its contents, and its use by mouse and by keyboard."""

import json
import socket
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack
from queue import Queue
from typing import NamedTuple

import pytest
import uvicorn
from activities.joint import Joint
from playwright.sync_api import BrowserContext, Page, expect

from tca_behaviours.activities import Application, one_for_all
from tca_behaviours.activities.components import Component
from tca_behaviours.activities.manager import Control, ControlField, Manager
from tca_behaviours.activities.page.app import page_app
from tca_behaviours.activities.page.live import LiveApplication
from tca_module import Command, Inform, Module, Task
from tca_module.testing import LocalCentral
from tca_tools.view.guards import PageKey
from view.conftest import OpenPage

pytestmark = pytest.mark.slow

TELL, MOVE = Command("tell joint", str), Inform("move joint", float)
CONTROLS = [
    Control("enable", "tell joint", {"": "enable"}, group="joint"),
    Control("speed", "move joint", fields=[ControlField("", 0.5, "m/s", 0.0, 1.0)], group="joint"),
]


class Town(NamedTuple):
    """A joint in an application, and the server of its page."""

    joint: Joint
    application: Application
    module: Module
    robot: ExitStack
    """The application's program. Closing this stack ends the program."""
    address: str
    key: str
    speeds: Queue[float]


@pytest.fixture
def town() -> Iterator[Town]:
    joint, speeds = Joint(), Queue[float]()
    application = Application("robot", [joint], one_for_all)
    with LocalCentral() as central, ExitStack() as robot:
        module = Module("robot", central)

        @module.handles(TELL)
        def put_command(_task: Task, what: str) -> None:
            joint.command.put(what)

        @module.handles(MOVE)
        def move(_task: Task, speed: float) -> None:
            speeds.put(speed)

        Manager(application, controls=CONTROLS, picture=lambda: PICTURE).handle_in(module)
        robot.enter_context(module.running())
        robot.enter_context(application.running())
        live, key = LiveApplication("robot", central), PageKey("tca activities")
        server = uvicorn.Server(
            uvicorn.Config(page_app(live, ["127.0.0.1"], key), log_level="warning")
        )
        with live.running(), socket.create_server(("127.0.0.1", 0)) as door:
            thread = threading.Thread(target=server.run, kwargs={"sockets": [door]})
            thread.start()
            address = f"http://127.0.0.1:{door.getsockname()[1]}/"
            try:
                yield Town(joint, application, module, robot, address, key.text, speeds)
            finally:
                live.stop()
                server.should_exit = True
                thread.join()


PICTURE = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 2 1"><rect width="2" height="1"/></svg>'
)
ROW = ".processor[data-processor='{}'] .activity[data-activity='{}']"


def allocated(town: Town) -> dict[str, list[str]]:
    return {
        one.name: [each.name for each in one.activities]
        for one in town.application.allocation().processors
    }


def test_application_page_shows_and_changes_a_running_one(town: Town, open_page: OpenPage) -> None:
    page = open_page(town.address, f"?key={town.key}")
    expect(page.locator("#status")).to_have_text("running")
    expect(page.locator("#name")).to_have_text("robot")
    assert town.key not in page.url
    assert page.locator("#picture").evaluate("image => image.naturalWidth") > 0
    expect(page.locator(".state.active")).to_have_text(
        ["inside", "unreferenced", "disabled", "stopped"]
    )
    page.get_by_role("button", name="enable").click()
    expect(page.locator(".state.active")).to_have_text(
        ["inside", "unreferenced", "enabled", "stopped"]
    )
    expect(page.locator("#said")).to_have_text("tell joint: done")
    page.get_by_label("speed").fill("0.25")
    page.get_by_role("button", name="speed").click()
    expect(page.locator("#said")).to_have_text("move joint: sent")
    assert town.speeds.get(timeout=60) == 0.25

    fast, slow = "x.movement.fast", "x.movement.slow"
    page.locator(f".activity[data-activity='{fast}']").drag_to(
        page.locator("[data-processor='new processor'] .head")
    )
    expect(page.locator(ROW.format("processor 1", fast))).to_be_visible()
    page.locator(f".activity[data-activity='{slow}']").drag_to(
        page.locator(ROW.format("processor 1", fast))
    )
    expect(page.locator(ROW.format("processor 1", slow))).to_be_visible()
    assert allocated(town)["processor 1"] == [slow, fast]
    expect(page.locator("#policy")).to_have_value("by hand")
    by_keyboard(page, town, slow, fast)

    page.locator("#policy").select_option("one_each")
    expect(page.locator(".processor:not(.basket)")).to_have_count(
        len(town.application.activity_names)
    )
    page.get_by_label(f"period of {fast}, in milliseconds").fill("50")
    page.get_by_label(f"period of {fast}, in milliseconds").press("Enter")
    expect(page.locator("#said")).to_have_text("set period in robot: done")
    page.get_by_label(f"period of {fast}, in milliseconds").fill("0")
    page.get_by_label(f"period of {fast}, in milliseconds").press("Enter")
    expect(page.locator("#said.bad")).to_contain_text("application refused")
    expect(page.get_by_label(f"period of {fast}, in milliseconds")).to_have_value("50")


def by_keyboard(page: Page, town: Town, slow: str, fast: str) -> None:
    """Use the arrows and letters that the help lists."""
    page.locator(ROW.format("processor 1", slow)).focus()
    page.keyboard.press("Alt+ArrowDown")
    expect(page.locator("[data-processor='processor 1'] .activity .name")).to_have_text(
        [fast, slow]
    )
    expect(page.locator(ROW.format("processor 1", slow))).to_be_focused()
    page.keyboard.press("ArrowUp")
    expect(page.locator(ROW.format("processor 1", fast))).to_be_focused()
    page.keyboard.press("n")
    expect(page.locator(ROW.format("processor 2", fast))).to_be_focused()
    page.keyboard.press("Delete")
    expect(page.locator(ROW.format("on no processor", fast))).to_be_focused()
    assert [one.name for one in town.application.allocation().unallocated] == [fast]
    page.keyboard.press("ArrowLeft")
    expect(page.locator(".processor:not(.basket) .activity:focus")).to_have_attribute(
        "data-activity", fast
    )


def test_verdict_is_red_when_measurement_refutes_the_analysis(
    town: Town, open_page: OpenPage
) -> None:
    hung = threading.Event()
    camera = Component[dict[str, int]]("camera", dict)
    camera.region("eye", period=0.5).state("open", activity=hung.wait, period=0.5, estimate=0.0001)
    page = open_page(town.address, f"?key={town.key}")
    try:
        town.application.add(camera)
        fast, slow = (
            [name for name in town.application.activity_names if name.startswith(component)]
            for component in ("x", "camera")
        )
        town.application.allocate({"processor 1": fast, "processor 2": slow})
        # The analysis then accepts the camera, however long a busy machine lets the others tick.
        town.application.set_priority("processor 2", 1)
        expect(page.locator("#verdict.bad")).to_have_text("refuted by measurement")
        expect(page.locator("[data-processor='processor 2'] .verdict.bad")).to_contain_text(
            "refuted by measurement: "
        )
    finally:
        hung.set()


@pytest.mark.soak
def test_application_stop_restart_and_loss_show_in_all_windows(
    town: Town, open_page: OpenPage, window: BrowserContext
) -> None:
    page = open_page(town.address, f"?key={town.key}")
    second = window.new_page()
    try:
        second.goto(town.address)  # without the key the page is read-only
        expect(second.locator("#status")).to_have_text("running")
        expect(second.get_by_role("button", name="stop")).to_be_disabled()
        page.get_by_role("button", name="enable").click()
        expect(second.get_by_text("enabled", exact=True)).to_have_attribute("aria-current", "true")
        page.get_by_role("button", name="stop").click()
        for one in (page, second):
            expect(one.locator("#status")).to_have_text("stopped")
        page.get_by_role("button", name="initialise").click()
        expect(second.get_by_text("disabled", exact=True)).to_have_attribute("aria-current", "true")
        page.get_by_role("button", name="start").click()
        expect(second.locator("#status")).to_have_text("running")
        town.robot.close()
        for one in (page, second):
            expect(one.locator("#problem")).to_contain_text(
                "module 'robot', which manages 'robot', is not connected"
            )
            expect(one.locator("#status")).to_have_text("lost")
        expect(page.get_by_role("button", name="enable")).to_be_disabled()
    finally:
        second.close()


def test_application_page_refuses_requests_without_its_key(town: Town) -> None:
    def post(key: str, asked: object) -> tuple[int, str]:
        request = urllib.request.Request(
            f"{town.address}api/send", json.dumps(asked).encode(), {"X-TCA-Key": key}, method="POST"
        )
        try:
            with urllib.request.urlopen(request, timeout=20) as answer:
                content = json.load(answer)
                return answer.status, content.get("said") or f"no: {content['error']}"
        except urllib.error.HTTPError as error:
            with error:
                return error.code, json.load(error)["error"]

    enable = {"message": "tell joint", "data": "enable"}
    assert post("wrong", enable) == (
        403,
        "this page is read-only: to steer, open the address that 'tca activities' printed",
    )
    assert post(town.key, enable) == (200, "tell joint: done")
    assert post(town.key, [])[0] == 400
    for asked, why in (
        ({"message": "dance"}, "no module has declared a message 'dance'"),
        ({"message": "tell joint", "data": 7}, "wants data of type str"),
        ({"message": "states of robot"}, "states of robot"),
    ):
        status, text = post(town.key, asked)
        assert (status, text.startswith("no: "), why in text) == (200, True, True), text
