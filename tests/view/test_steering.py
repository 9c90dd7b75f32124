"""Tasks of a live run are killed, suspended, resumed and retried from the page, by whoever has its key."""

import json
import threading
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from click.testing import CliRunner
from integration.programs import Central, central
from playwright.sync_api import expect
from tools.story import walking

from tca_live.tasks import retry
from tca_module import Client, Command, Goal, Module, Task, connect
from tca_tools.view.steering import Steering
from tca_wire.vocabulary import Outcome
from view.conftest import Look

pytestmark = pytest.mark.slow

PATROL, MOVE = Goal("patrol", int), Command("move", int)


class Robot(NamedTuple):
    """A central with two modules, and a user of it."""

    daemon: Central
    user: Client
    begun: list[int]
    go_on: threading.Event
    """Until it is set, moves last."""


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


def test_a_task_is_suspended_resumed_retried_and_killed(look: Look, serve: Serve, robot: Robot) -> None:
    task, steering = robot.user.goal(PATROL, 3), Steering(robot.daemon.address)
    address = serve(robot.daemon.journal, steering)
    page = look(address, f"?key={steering.key}#task={task.id}")
    assert steering.key not in page.url
    expect(page.locator("#steering button")).to_have_text(["kill", "suspend", "retry"])
    for what, then, said in (
        ("suspend", ["kill", "resume", "retry"], "patrol {1}: suspended"),
        ("resume", ["kill", "suspend", "retry"], "patrol {1}: resumed"),
    ):
        page.locator(f"[data-steer={what}]").click()
        expect(page.locator("#steer h2")).to_have_text(f"{what} patrol {{1}}?")
        expect(page.locator("#steer p").first).to_contain_text("Under it: 3 living tasks.")
        page.locator("#steer button[type=submit]").click()
        expect(page.locator("#steering [role=status]")).to_have_text(said)
        expect(page.locator("#steering button")).to_have_text(then)
    page.locator("[data-steer=retry]").click()
    page.locator("#steer button[type=submit]").click()
    expect(page.locator("#steering [role=status]")).to_have_text("patrol {1}: to be handled again")
    robot.go_on.set()
    expect(page.locator("#counts")).to_contain_text("4 achieved")
    assert robot.begun == [3, 3]
    robot.go_on.clear()
    again = robot.user.goal(PATROL, 2)
    page.locator(f".row[data-task='{again.id}']").click()
    page.locator("[data-steer=kill]").click()
    page.locator("#steer-not").click()
    assert again.info() is not None
    page.locator("[data-steer=kill]").click()
    page.locator("#steer input").fill("the battery is low")
    page.locator("#steer input").press("Enter")
    expect(page.locator("#steering [role=status]")).to_contain_text("told to end")
    robot.go_on.set()
    assert again.wait(30) is Outcome.KILLED
    expect(page.locator("#task .lead").last).to_contain_text("killed: the battery is low (by the command 'tca view')")
    expect(page.locator("#steering button")).to_have_count(0)


def test_who_looks_at_the_past_or_has_no_key_steers_nothing(look: Look, serve: Serve, robot: Robot) -> None:
    task, steering = robot.user.goal(PATROL, 1), Steering(robot.daemon.address)
    address = serve(robot.daemon.journal, steering)
    page = look(address, f"?key={steering.key}#t=0&task={task.id}")
    page.locator("#steering button", has_text="go to the end").click()
    expect(page.locator("[data-steer=kill]")).to_be_visible()
    page.locator("[data-steer=kill]").click()
    page.evaluate("sessionStorage.setItem('key', 'of another viewer')")
    with page.expect_event("console") as line:  # the browser notes what was refused
        page.locator("#steer button[type=submit]").click()
    assert "403" in line.value.text
    expect(page.locator("#steering [role=status]")).to_contain_text("to steer, open the address that 'tca view'")
    expect(page.locator("[data-steer]")).to_have_count(0)
    assert task.info() is not None


def read(address: str, what: str) -> bytes:
    with urllib.request.urlopen(f"{address}api/{what}", timeout=20) as answer:
        told: bytes = answer.read()
    return told


def post(address: str, body: Any, **headers: str) -> tuple[int, str]:
    """What the server says to a request."""
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    asked = urllib.request.Request(f"{address}api/steer", json.dumps(body).encode(), named)
    try:
        with urllib.request.urlopen(asked, timeout=20) as answer:
            return answer.status, json.load(answer)["said"]
    except urllib.error.HTTPError as error:
        with error:
            told = error.read()
        return error.code, json.loads(told)["error"] if told.startswith(b"{") else told.decode()


def test_nobody_else_is_obeyed(serve: Serve, robot: Robot, tmp_path: Path) -> None:
    task, steering = robot.user.goal(PATROL, 1), Steering(robot.daemon.address)
    address = serve(robot.daemon.journal, steering)
    (run,) = [one["run"] for one in json.loads(read(address, "runs"))]
    read(address, "frame")
    wish, key = {"run": run, "task": task.id, "what": "kill"}, steering.key
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
    told = post(address, wish, X_TCA_Key=key, Origin=address.rstrip("/"))
    assert told == (200, "patrol {1}: killed") or "told to end" in told[1]
    assert post(serve(robot.daemon.journal), wish, X_TCA_Key=key)[0] == 404  # it only looks
    ended = serve(walking().write(tmp_path / "walk"), steering)
    told = post(ended, {"run": "", "task": 1, "what": "kill"}, X_TCA_Key=key)
    assert told == (400, "this run has ended: nothing can be done to its tasks")
    with central(tmp_path / "second", "--quiet") as second:
        other = Steering(second.address)
        address = serve(robot.daemon.journal, other)
        read(address, "frame")
        status, why = post(address, wish, X_TCA_Key=other.key)
        assert (status, "runs another run than the one shown" in why) == (400, True)


def test_the_command_retries_too(robot: Robot) -> None:
    robot.user.goal(PATROL, 0).wait(30)
    task = robot.user.goal(PATROL, 1)
    while not task.children():
        pass
    told = CliRunner().invoke(retry, ["patrol", "--central", robot.daemon.address])
    assert (told.exit_code, told.output) == (0, f"patrol {{{task.id}}}: to be handled again\n")
    robot.go_on.set()
    assert task.wait(30) is Outcome.DONE
    assert robot.begun == [0, 1, 1]
