"""Task formats from other modules. A malformed format does no harm."""

import inspect
import json
from typing import Any

import pytest

from tca_behaviours.missions.client.offered_task import offered_tasks
from tca_behaviours.missions.client.stub import stub_text
from tca_module import MessageInfo
from tca_wire.messages.formats import MISSION_TASK

GOOD = {"server": "rover", "task": "Drive"}


def formatted(schema: Any) -> MessageInfo:
    return MessageInfo("rover.Drive", "command", json.dumps(schema), "", "", "", ())


@pytest.mark.parametrize(
    "schema",
    [
        [MISSION_TASK],
        {MISSION_TASK: None},
        {MISSION_TASK: "rover"},
        {MISSION_TASK: {"server": 3, "task": []}},
        {MISSION_TASK: {}},
        {MISSION_TASK: {"server": "rover"}},
        {MISSION_TASK: {**GOOD, "parameters": 3}},
    ],
)
def test_schema_with_malformed_mark_offers_no_task(schema: Any) -> None:
    assert list(offered_tasks([formatted(schema)])) == []


@pytest.mark.parametrize(
    "fields",
    [
        {}, {"properties": None}, {"properties": 3}, {"properties": {"x": 3}}, {"$ref": "#/$defs/None"}, {"$ref": 3},
        {"properties": {"x": {"enum": [[1], {}]}, "y": {"anyOf": []}, "z": {"anyOf": [3]}, "w": {"type": 3}}},
        {"properties": {"not a name": {}, "class": {"default": '"""\\'}, "x": {"description": 3, "default": [{}]}}},
        {"$ref": "#/$defs/A", "$defs": {"A": {"properties": {"x": {"$ref": "#/$defs/A"}}}}, "required": [3, "x"]},
        {"properties": {"x": {"type": "array", "items": {"$ref": "#/$defs/B"}}}, "$defs": {"B": {"type": "array", "items": {"$ref": "#/$defs/B"}}}},
    ],
)  # fmt: skip
def test_task_with_malformed_parameters_can_be_shown(fields: dict[str, Any]) -> None:
    (task,) = offered_tasks([formatted({MISSION_TASK: GOOD, **fields})])
    assert str(task.signature).endswith("TaskEnd")
    assert isinstance(task.signature, inspect.Signature)
    assert task.help_text
    compile(stub_text("rover", [task]), "rover_tasks.py", "exec")


@pytest.mark.parametrize("name", ["import", "Drive", "None"])
@pytest.mark.parametrize("text", ['says "far"', "ends with \\", 'in """ quotes', "two\nlines"])
def test_stub_is_valid_python_for_hostile_names(name: str, text: str) -> None:
    shown = {"server": text, "task": name, "help": text, "parameters": ["x"]}
    schema = {MISSION_TASK: shown, "properties": {"x": {"type": "number", "default": float("nan")}}}
    names: dict[str, Any] = {}
    (task,) = offered_tasks([formatted(schema)])
    stub = (
        stub_text(text, [task])
        .replace("if TYPE_CHECKING:", "if True:")
        .replace("import BaseMission", "import Mission")
    )
    exec(compile(stub, "tasks.py", "exec"), names)
    (made,) = (
        one
        for key, one in names.items()
        if key.endswith("Mission") and getattr(one, "SERVER", None) == text
    )
    assert hasattr(made, name) is (name == "Drive")
