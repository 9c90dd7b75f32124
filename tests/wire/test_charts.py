"""Machines as data: what is none is not taken for one."""

import msgspec
import pytest

from tca_wire.charts import ActiveStates, MachineChart, read_active, read_machine

FORMAT = '{"$ref":"#/$defs/MachineChart"}'
WHOLE = {"label": "patrol", "kind": "sequence", "parent": -1}
TASK = {"label": "GoTo", "kind": "task", "parent": 0}


@pytest.mark.parametrize(
    "states",
    [
        [],
        [TASK],
        [WHOLE, WHOLE],
        [WHOLE, {**TASK, "parent": 1}],
        [WHOLE, TASK, {**TASK, "parent": 1}],
        [WHOLE, {**TASK, "next": {"completed": 2}}],
        [WHOLE, {**TASK, "next": {"won": 1}}],
        [WHOLE, {**TASK, "kind": "any"}],
    ],
)
def test_what_is_no_machine(states: list[object]) -> None:
    assert read_machine(FORMAT, msgspec.msgpack.encode({"name": "patrol", "states": states})) is None


def test_a_machine_and_its_active_states() -> None:
    body = msgspec.msgpack.encode({"name": "patrol", "states": [WHOLE, {**TASK, "next": {"failed": 1}}]})
    chart = read_machine(FORMAT, body)
    assert isinstance(chart, MachineChart)
    assert chart.inside(0) == [1]
    assert read_machine("{}", body) is None
    told = ActiveStates(["GoTo"], "Wait has completed", [0, 1])
    assert read_active(msgspec.msgpack.encode(told)) == told
    assert read_active(b"") == ActiveStates([], "", [])
