"""Machines with a preview as data: bytes that are none are not taken for one."""

import msgspec
import pytest

from tca_wire.coordination import CoordinationChart, CoordinationReport, Foreseen, read_chart, read_report

FORMAT = '{"$ref":"#/$defs/CoordinationChart"}'
HOLDING = {"label": "deliver", "kind": "compound"}
WAITING = {"label": "waiting", "kind": "wait", "parent": 0}


@pytest.mark.parametrize(
    ("states", "arrows"),
    [
        ([], []),
        ([WAITING], []),
        ([HOLDING, {**WAITING, "parent": 1}], []),
        ([HOLDING, {**WAITING, "kind": "idle"}], []),
        ([HOLDING, WAITING], [{"source": 1, "target": 2, "symbol": "done"}]),
    ],
)
def test_what_is_no_machine(states: list[object], arrows: list[object]) -> None:
    body = msgspec.msgpack.encode({"machine": "deliver", "agents": [], "states": states, "arrows": arrows})
    assert read_chart(FORMAT, body) is None


def test_a_machine_and_a_report() -> None:
    arrow = {"source": 1, "target": 1, "symbol": "done"}
    body = msgspec.msgpack.encode({"machine": "deliver", "agents": [], "states": [HOLDING, WAITING], "arrows": [arrow]})
    assert isinstance(read_chart(FORMAT, body), CoordinationChart)
    assert read_chart("{}", body) is None
    report = CoordinationReport(1, "done", 1, [Foreseen(1, 0.5, 0.5)])
    assert read_report(msgspec.msgpack.encode(report)) == report
    assert read_report(b"\xc1") is None
