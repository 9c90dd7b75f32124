"""Parameters are declared in the class, published in the format, and checked before sending."""

import json
from typing import Annotated, Any

import msgspec
import pytest
from missions.gripper import Gripper, Robot, Turn, serving
from msgspec import Meta

from tca_behaviours.missions import Environment, OnceTask, PeriodicTask, TaskServer, parameter
from tca_module import BadData, BadFormat


def shape(robot: Robot, task: str) -> dict[str, Any]:
    """Return the published format of a task's data."""
    schema: dict[str, Any] = json.loads(robot.user.declared(f"gripper.{task}").data.schema)
    return schema


def test_task_format_describes_its_parameters() -> None:
    with serving() as robot:
        turn = shape(robot, "Turn")
        assert turn["x-tca-mission"] == {
            "server": "gripper",
            "task": "Turn",
            "help": "Turn the wrist.",
            "periodic": True,
            "parameters": [
                "angle",
                "steps",
                "fails_in",
                "task_timeout",
                "foreground",
                "task_period",
            ],
        }
        fields = turn["$defs"]["Turn"]["properties"]
        assert fields["angle"] == {
            "type": "number",
            "default": 1.0,
            "minimum": -3,
            "maximum": 3,
            "description": "How far, in radians",
        }
        assert fields["task_period"]["default"] == 0.1
        grasp = shape(robot, "Grasp")
        assert grasp["$defs"]["Grasp"]["required"] == ["force"]
        assert "task_period" not in grasp["$defs"]["Grasp"]["properties"]


@pytest.mark.parametrize(
    ("task", "parameters", "expected"),
    [
        ("Turn", {"angel": 1}, "field 'angel' is unknown: did you mean 'angle'?"),
        ("Turn", {"angle": 4}, "field 'angle' must be at most 3, not 4"),
        ("Turn", {"steps": 0}, "field 'steps' must be at least 1, not 0"),
        ("Turn", {"steps": "two"}, "field 'steps' must be a whole number"),
        ("Turn", {"task_period": 0}, "field 'task_period' must be at least 0.001"),
        ("Grasp", {}, "field 'force' is missing"),
    ],
)
def test_invalid_parameter_is_rejected_before_sending(
    task: str, parameters: Any, expected: str
) -> None:
    with serving() as robot:
        before = len(robot.central.facts)
        message = robot.user.declared(f"gripper.{task}")
        with pytest.raises(BadData) as wrong:
            robot.user.command(message, parameters)
        assert expected in str(wrong.value)
        assert len(robot.central.facts) == before


class Place(msgspec.Struct):
    x: float
    y: float = 0.0


class Go(OnceTask[Gripper]):
    """Go.

    To one place after another.
    """

    places: list[Place] = []  # noqa: RUF012 - a parameter
    speed: Annotated[float, Meta(gt=0, le=2, description="In m/s")] = 1.0
    label: str | None = None
    _hidden: int = 3

    def iterate(self) -> None:
        self.report(f"{self.places} {self.speed} {self.label}")
        self.places.append(Place(9))


def test_parameters_accept_any_sendable_type() -> None:
    with serving(Go) as robot:
        first = robot.send("Go", places=[Place(1, 2)], label="home")
        robot.after(0)
        assert first.result().text == "[Place(x=1.0, y=2.0)] 1.0 home"
        for _ in range(2):
            again = robot.send("Go")
            robot.after(0)
            assert again.result().text == "[] 1.0 None"
        assert shape(robot, "Go")["x-tca-mission"]["parameters"] == [
            "places",
            "speed",
            "label",
            "task_timeout",
            "foreground",
        ]


def test_inherited_parameters_can_have_other_defaults() -> None:
    class Wiggle(Turn):
        angle = 0.5
        times: int = 2
        task_period = 0.05

    with serving(Wiggle) as robot:
        fields = shape(robot, "Wiggle")["$defs"]["Wiggle"]["properties"]
        assert fields["angle"]["default"] == 0.5
        assert fields["angle"]["maximum"] == 3
        assert fields["task_period"]["default"] == 0.05
        assert fields["times"]["default"] == 2
        robot.send("Wiggle", steps=2)
        assert robot.after(1)[1:3] == ["0.00 Wiggle step 1", "0.05 Wiggle step 2"]


class OutOfRange(Turn):
    angle: float = parameter(4.0, minimum=-3, maximum=3)


class WrongType(Turn):
    angle: float = parameter("far")  # type: ignore[assignment]


class Reserved(Turn):
    report: str = "?"  # type: ignore[assignment]


class Given(Turn):
    env = Gripper()


class Unsendable(Turn):
    lock: Gripper


class Unknown(Turn):
    place: "Nowhere"  # type: ignore[name-defined]  # noqa: F821


@pytest.mark.parametrize(
    ("task", "expected"),
    [
        (
            OutOfRange,
            "task OutOfRange: the default of parameter 'angle' does not fit: Expected `float` <= 3.0",
        ),
        (
            WrongType,
            "task WrongType: the default of parameter 'angle' does not fit: Expected `float`, got `str`",
        ),
        (
            Reserved,
            "task Reserved: parameter 'report' hides a method or an attribute of every task: choose another name",
        ),
        (Given, "task Given: the server sets 'env': choose another name"),
        (
            Unsendable,
            "task Unsendable: parameter 'lock' can't be sent: Gripper has no format: use a dataclass, ",
        ),
        (
            Unknown,
            "task Unknown: the types of its parameters can't be read: name 'Nowhere' is not defined",
        ),
    ],
)
def test_invalid_parameter_declaration_is_rejected(
    task: type[PeriodicTask[Any]], expected: str
) -> None:
    with pytest.raises(BadFormat) as wrong:
        TaskServer("gripper", Gripper(), [task])
    assert str(wrong.value).startswith(expected)


def test_task_for_any_environment_is_offered() -> None:
    class Say(OnceTask[Environment]):
        text: str

        def iterate(self) -> None:
            self.report(self.text)

    with serving(Say) as robot:
        sent = robot.send("Say", text="hello")
        robot.after(0)
        assert sent.result().text == "hello"
