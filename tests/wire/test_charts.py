"""Machines as data. Other bytes are not read as a machine."""

import msgspec
import pytest

from tca_wire.charts import ActiveStates, MachineChart, read_active, read_machine
from tca_wire.coordination import CoordinationReport, Foreseen, read_report

FORMAT = '{"$ref":"#/$defs/MachineChart"}'
WHOLE = {"label": "patrol", "kind": "sequence"}
TASK = {"label": "GoTo", "kind": "task", "parent": 0}


@pytest.mark.parametrize(
    ("states", "arrows"),
    [
        ([], []),
        ([TASK], []),
        ([WHOLE, {**TASK, "parent": 1}], []),
        ([WHOLE, TASK, {**TASK, "parent": 1}], []),
        ([WHOLE, {**TASK, "kind": "any"}], []),
        ([WHOLE, TASK], [{"source": 1, "target": 2, "symbol": "done"}]),
    ],
)
def test_malformed_machine_reads_as_none(states: list[object], arrows: list[object]) -> None:
    body = msgspec.msgpack.encode({"name": "patrol", "states": states, "arrows": arrows})
    assert read_machine(FORMAT, body) is None


def test_machine_and_its_active_states_are_read() -> None:
    arrow = {"source": 1, "target": 1, "symbol": "failed"}
    body = msgspec.msgpack.encode({"name": "patrol", "states": [WHOLE, TASK], "arrows": [arrow]})
    chart = read_machine(FORMAT, body)
    assert isinstance(chart, MachineChart)
    assert (chart.inside(0), chart.entered(0), chart.around(1)) == ([1], 1, [1, 0])
    assert read_machine("{}", body) is None
    active = ActiveStates(["GoTo"], "Wait has completed", [0, 1])
    assert read_active(msgspec.msgpack.encode(active)) == active
    assert read_active(b"") == ActiveStates([], "", [])
    report = CoordinationReport(1, "done", 1, [Foreseen(1, 0.5, 0.5)])
    assert read_report(msgspec.msgpack.encode(report)) == report
    assert read_report(b"\xc1") is None
