"""The code on the pages about missions and task servers runs as printed."""

import functools
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import tca_behaviours.missions
from tca_behaviours.missions import (
    Environment,
    Mission,
    OnceTask,
    PeriodicTask,
    Status,
    TaskServer,
    parameter,
)
from tca_module import connect
from tca_module.testing import LocalCentral

DOCS = Path(__file__).parents[2] / "docs/packages"
PATROL = "from tca_behaviours.missions import ConditionIsCompleted, ConditionVerified, Mission\n"
UNDER_WAY = '{"steps_of":"test","version":2}\n{"step":"to the kitchen","is":"begun"}\n'


def blocks(page: str) -> list[str]:
    return re.findall(r"```python\n(.*?)```", (DOCS / page).read_text(), re.DOTALL)


def block(page: str, beginning: str) -> str:
    (one,) = [one for one in blocks(page) if one.startswith(beginning)]
    return one


class Cart(Environment):
    """A cart that can't reach some places. Rain starts after some photographs."""

    def __init__(self) -> None:
        super().__init__()
        self.been: list[float] = []
        self.photographs: list[float] = []
        self.cut_off = set[float]()
        self.rains_after = 3
        self.file_then = b""

    @property
    def place(self) -> float:
        return self.been[-1]


class Drive(PeriodicTask[Cart]):
    goal: float = parameter(0.0, minimum=0, maximum=10)

    def iterate(self) -> Status:
        if self.goal in self.env.cut_off:
            return Status.RUNNING
        self.env.been.append(self.goal)
        return Status.COMPLETED


class Photograph(OnceTask[Cart]):
    def iterate(self) -> None:
        self.env.photographs.append(self.env.place)
        if len(self.env.photographs) == self.env.rains_after:
            self.env.file_then = Path("patrol.steps").read_bytes()
            self.env.cut_off = {1.0, 6.0}


class WaitForRain(PeriodicTask[Cart]):
    def iterate(self) -> Status:
        return Status.COMPLETED if self.env.cut_off else Status.RUNNING


@pytest.fixture
def cart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Cart]:
    """Serve the cart to all missions of the page."""
    monkeypatch.chdir(tmp_path)
    with LocalCentral() as central:
        cart = Cart()
        monkeypatch.setattr(
            tca_behaviours.missions,
            "Mission",
            functools.partial(Mission, central=central, name="test"),
        )
        with TaskServer(
            "cart", cart, [Drive, Photograph, WaitForRain], rate=100.0, central=central
        ).running():
            yield cart


def run(beginning: str, **names: Any) -> None:
    code = block("missions.md", beginning)
    exec(code, {**vars(tca_behaviours.missions), **names})


def run_in_mission(beginning: str, **names: Any) -> None:
    with tca_behaviours.missions.Mission("cart", checkpoint="test.steps") as mission:
        run(beginning, mission=mission, **names)


def test_missions_page_imports_every_name_it_uses() -> None:
    page = (DOCS / "missions.md").read_text()
    imported = set[str]()
    for words in re.findall(
        r"^from tca_behaviours.missions import (\([^)]*\)|.*)$", page, re.MULTILINE
    ):
        imported |= set(re.findall(r"\w+", words))
    offered = {
        name
        for name in vars(tca_behaviours.missions)
        if not (name.startswith("_") or name.islower())
    }
    assert {name for name in offered if re.search(rf"\b{name}\b", page)} <= imported
    assert imported <= {*offered, "parameter", "status_of"}


def test_resumed_patrol_is_still_interrupted_by_rain(
    cart: Cart, capsys: pytest.CaptureFixture[str]
) -> None:
    run(PATROL)
    assert (cart.photographs, cart.been[-1]) == ([6, 1, 6], 0)
    Path("patrol.steps").write_bytes(cart.file_then)  # as after a kill in round 2
    cart.photographs, cart.cut_off, cart.rains_after = [], set(), 2
    run(PATROL)
    assert (cart.photographs, cart.been[-1]) == ([6, 1], 0)
    assert capsys.readouterr().out == "it rains\nit rains\n"


def test_page_example_updates_a_task_while_waiting(cart: Cart) -> None:
    cart.cut_off = {6.0}
    run_in_mission("drive = mission.start(")
    assert cart.been == [2]


@pytest.mark.parametrize(("answer", "been"), [("yes", []), ("no", [6])])
def test_page_example_asks_about_an_uncertain_step(
    cart: Cart, answer: str, been: list[float]
) -> None:
    Path("test.steps").write_text(UNDER_WAY)
    run_in_mission("try:\n    mission.step(", input=lambda _: answer)
    assert cart.been == been


def test_short_page_examples_run(cart: Cart) -> None:
    run_in_mission("try:\n    mission.Drive(goal=3.0, task_timeout")
    run('with Mission("cart", checkpoint="delivery.steps")')
    assert cart.been == [3, 6, 0, 1, 2, 0]
    cart.been.append(9)
    cart.cut_off = {10.0}
    run_in_mission("class TooFar:", cart=cart)


def test_page_example_of_a_once_task_and_its_test_runs() -> None:
    names: dict[str, Any] = {**vars(tca_behaviours.missions), "__name__": __name__}
    for beginning in (
        "from tca_behaviours.missions import (\n    Environment,\n    Mission,",
        "class OpenDoor(",
    ):
        exec(block("task-servers.md", beginning), names)
    exec(block("task-servers.md", "from tca_module import connect\n"), names)
    with LocalCentral(stepped=True) as central, connect("test", central) as user:
        server = TaskServer("oven", names["Oven"](), tasks=[names["OpenDoor"]], central=central)
        with server.running():
            door = server.definitions["OpenDoor"]
            sent = user.command(door.message, door.parameters(seconds=2.0))
            central.advance(1.0)
            assert server.environment.door_is_open  # type: ignore[attr-defined]
            central.advance(2.0)
            assert repr(sent.result()) == "TaskEnd(status=COMPLETED, text='', overruns=0)"
            assert not server.environment.door_is_open  # type: ignore[attr-defined]
