"""Tasks of a live run are killed, suspended, resumed and retried from a page with its key."""

import json
import threading
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from playwright.sync_api import Locator, Page, expect
from processes import Central, central
from tools.story import walking

from tca_module import Client, Command, Goal, Module, Task, connect
from tca_tools.live.steering import steer
from tca_tools.view.app import Steering
from tca_wire.vocabulary import Outcome
from view.conftest import OpenPage

pytestmark = pytest.mark.slow

PATROL, MOVE = Goal("patrol", int), Command("move", int)


class Robot(NamedTuple):
    """A central with two modules and a user."""

    daemon: Central
    user: Client
    begun: list[int]
    go_on: threading.Event
    """An event. Moves return after it is set."""


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[Robot]:
    with central(tmp_path, "--quiet") as daemon, connect("user", daemon.address) as user:
        head, legs = Module("head", daemon.address), Module("legs", daemon.address)
        robot = Robot(daemon, user, [], threading.Event())

        @head.handles(PATROL)
        def patrol(task: Task, rounds: int) -> None:
            robot.begun.append(rounds)
            with task.sequence():
                for number in range(rounds):
                    task.command(MOVE, number)

        @legs.handles(MOVE)
        def move(_task: Task, _number: int) -> None:
            robot.go_on.wait(30)

        with head.running(), legs.running():
            try:
                yield robot
            finally:
                robot.go_on.set()


Serve = Callable[..., str]


def steering_result(page: Page) -> Locator:
    """Return the place of the page that shows the last request's result."""
    return page.locator("#steering [role=status]")


def ask(page: Page, what: str, task: int, rows: int) -> None:
    """Open the dialog of a request, once *rows* tasks are visible and one of them is handled."""
    expect(page.locator(".row")).to_have_count(rows)
    expect(page.locator("#counts [data-state=handling]")).to_be_visible()
    page.locator(f".row[data-task='{task}']").click()
    page.locator(f"[data-steer={what}]").click()
    expect(page.locator("#steer h2")).to_have_text(f"{what} patrol {{{task}}}?")


def confirm(page: Page) -> None:
    page.locator("#steer button[type=submit]").click()


def test_page_suspends_resumes_and_retries_a_task(
    open_page: OpenPage, serve: Serve, robot: Robot
) -> None:
    task, steering = robot.user.goal(PATROL, 3), Steering(robot.daemon.address)
    address = serve(robot.daemon.journal, steering)
    page = open_page(address, f"?key={steering.key.text}#t=0&task={task.id}")
    assert steering.key.text not in page.url
    page.locator("#steering button", has_text="go to the end").click()  # the past cannot be steered
    expect(page.locator("#steering button")).to_have_text(["cancel", "kill", "suspend", "retry"])
    for what, then, result in (
        ("suspend", ["cancel", "kill", "resume", "retry"], "patrol {1}: suspended"),
        ("resume", ["cancel", "kill", "suspend", "retry"], "patrol {1}: resumed"),
        ("retry", ["cancel", "kill", "suspend", "retry"], "patrol {1}: to be handled again"),
    ):
        ask(page, what, task.id, rows=4)
        expect(page.locator("#steer p").first).to_contain_text("Under it: 3 living tasks.")
        confirm(page)
        expect(steering_result(page)).to_have_text(result)
        expect(page.locator("#steering button")).to_have_text(then)
    robot.go_on.set()
    expect(page.locator("#counts")).to_contain_text("4 achieved")
    assert robot.begun == [3, 3]


def test_page_kills_a_task_with_reason_and_key(
    open_page: OpenPage, serve: Serve, robot: Robot
) -> None:
    task, steering = robot.user.goal(PATROL, 2), Steering(robot.daemon.address)
    page = open_page(serve(robot.daemon.journal, steering), f"?key={steering.key.text}")
    ask(page, "kill", task.id, rows=3)
    page.locator("#steer-not").click()
    assert task.info() is not None
    ask(page, "kill", task.id, rows=3)
    page.locator("#steer input").fill("the battery is low")
    page.locator("#steer input").press("Enter")
    expect(steering_result(page)).to_contain_text("ends when its running handlers have returned")
    robot.go_on.set()
    assert task.wait(30) is Outcome.KILLED
    expect(page.locator("#task .lead").last).to_contain_text(
        "killed: the battery is low (by the command 'tca view')"
    )
    expect(page.locator("#steering button")).to_have_count(0)
    robot.go_on.clear()
    other = robot.user.goal(PATROL, 1)
    ask(page, "kill", other.id, rows=5)
    page.evaluate("sessionStorage.setItem('key', 'of another viewer')")
    confirm(page)
    expect(steering_result(page)).to_contain_text(
        "to steer, open the address that 'tca view' printed"
    )
    expect(page.locator("[data-steer]")).to_have_count(0)
    assert other.info() is not None
    epoch = robot.user.status()["epoch"]
    assert "ends when its running handlers" in steer(
        robot.daemon.address, epoch, "cancel", other.id, "enough"
    )


def read(address: str, what: str) -> bytes:
    with urllib.request.urlopen(f"{address}api/{what}", timeout=20) as answer:
        content: bytes = answer.read()
    return content


def post(address: str, body: Any, **headers: str) -> tuple[int, str]:
    """Return the server's status and text for a request to steer."""
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    asked = urllib.request.Request(f"{address}api/steer", json.dumps(body).encode(), named)
    try:
        with urllib.request.urlopen(asked, timeout=20) as answer:
            return answer.status, json.load(answer)["said"]
    except urllib.error.HTTPError as error:
        with error:
            content = error.read()
        return error.code, json.loads(content)["error"] if content.startswith(
            b"{"
        ) else content.decode()


def test_page_refuses_to_steer_without_the_key(serve: Serve, robot: Robot, tmp_path: Path) -> None:
    task, steering = robot.user.goal(PATROL, 1), Steering(robot.daemon.address)
    address = serve(robot.daemon.journal, steering)
    (run,) = [one["run"] for one in json.loads(read(address, "runs"))]
    read(address, "frame")
    wish, key = {"run": run, "task": task.id, "what": "kill"}, steering.key.text
    for headers, status in (
        ({}, 403),
        ({"X_TCA_Key": "x" + key}, 403),
        ({"X_TCA_Key": key, "Origin": "http://evil.example"}, 403),
        ({"X_TCA_Key": key, "Origin": "null"}, 403),
        ({"X_TCA_Key": key, "Host": "evil.example", "Origin": "http://evil.example"}, 400),
    ):
        assert post(address, wish, **headers)[0] == status
    nonsense: tuple[Any, ...] = (
        [],
        {"what": "kill"},
        wish | {"what": "dance"},
        wish | {"run": "other"},
        wish | {"task": 99},
    )
    for wrong in nonsense:
        assert post(address, wrong, X_TCA_Key=key)[0] == 400
    assert task.info() is not None
    reply = post(address, wish, X_TCA_Key=key, Origin=address.rstrip("/"))
    assert (
        reply == (200, "patrol {1}: killed")
        or "ends when its running handlers have returned" in reply[1]
    )
    assert (
        post(serve(robot.daemon.journal), wish, X_TCA_Key=key)[0] == 404
    )  # a server without steering
    ended = serve(walking().write(tmp_path / "walk"), steering)
    reply = post(ended, {"run": "", "task": 1, "what": "kill"}, X_TCA_Key=key)
    assert reply == (400, "this run has ended: nothing can be done to its tasks")
    with central(tmp_path / "second", "--quiet") as second:
        other = Steering(second.address)
        address = serve(robot.daemon.journal, other)
        read(address, "frame")
        status, why = post(address, wish, X_TCA_Key=other.key.text)
        assert (status, "has another run than the one shown" in why) == (400, True)
