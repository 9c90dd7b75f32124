"""The benchmark works. All cases of our own contestants yield figures, which no test judges."""

import math
from pathlib import Path

import msgspec
import pytest
from click.testing import CliRunner

from dev.benchmarks.messages.cases import STAGES, TASK_PEERS, Case, Entry, Needs, Stage, chosen
from dev.benchmarks.messages.command import bench
from dev.benchmarks.messages.results import Report
from dev.benchmarks.messages.running import Results, lacking, run

QUICK = ("--quick", "--rounds", "1", "--seconds", "0.001")


@pytest.mark.slow
@pytest.mark.soak
def test_benchmark_reports_figures_and_finite_ratios(tmp_path: Path) -> None:
    path = tmp_path / "figures.json"
    result = CliRunner().invoke(bench, [*QUICK, "--json", str(path)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    report = msgspec.json.decode(path.read_bytes(), type=Report)
    assert report.missing == {}
    assert [(table.stage, table.case) for table in report.tables] == [
        (stage.title, case.name) for stage in STAGES for case in stage.cases
    ]
    for table in report.tables:
        assert len(table.rows) >= 2, table.case
        for row in table.rows:
            figures = [row.median, row.best, row.worst, *row.rounds]
            assert all(map(math.isfinite, figures)), row
            assert row.ratio is None or 0 < row.ratio < math.inf, row
            assert (row.ratio is not None) == bool(table.reference), row
    assert "round trip" in result.stdout


def test_uninstalled_contestant_is_left_out_by_name() -> None:
    needs = Needs(("no_such_package", "no.such.package"), ("no-such-program",), "pip install it")
    assert (
        lacking(needs)
        == "package no_such_package, package no.such.package, program no-such-program"
    )
    assert not lacking(Needs(("zmq", "msgspec.msgpack"), ("sh",)))
    entry, lines = Entry("Missing", "peers.missing", "Missing", needs=needs), list[str]()
    result = run(
        [Stage("any", (Case("round trip", "round_trip", arguments=(100,)),), (entry,), "")],
        1,
        0.001,
        lines.append,
    )
    assert result.missing["Missing"].endswith("not installed: pip install it")
    assert any("Missing is left out" in line for line in lines)


@pytest.mark.soak
@pytest.mark.slow
def test_broken_contestant_is_excluded_and_the_others_run() -> None:
    (stage,) = chosen(
        STAGES, lambda name: name == "round trip", lambda entry: entry.title == "zmq.proxy"
    )[:1]
    broken = Entry("broken", "own.library", "Library", {"journal": "no such journal"})
    result: Results = run(
        [Stage("any", stage.cases, (broken, *stage.entries), "zmq.proxy")], 1, 0.001, lambda _: None
    )
    assert result.missing["broken"].startswith("it broke: KeyError")
    assert list(result.measured[0].rows) == ["zmq.proxy"]


def test_benchmark_cases_are_chosen_by_name() -> None:
    found = chosen(STAGES, lambda name: name == "tasks", lambda entry: not entry.needs.packages)
    assert [stage.title for stage in found] == ["tasks"]
    assert {entry.title for entry in TASK_PEERS}.isdisjoint(one.title for one in found[0].entries)
    result = CliRunner().invoke(bench, ["--only", "nonsense"])
    assert result.exit_code == 2
    assert "no case 'nonsense': --list names them" in result.output
    assert "commands, 100 open" in CliRunner().invoke(bench, ["--list"]).stdout


def test_benchmark_refuses_an_unwritable_result_file(tmp_path: Path) -> None:
    result = CliRunner().invoke(
        bench, [*QUICK, "--json", str(tmp_path / "nowhere" / "figures.json")]
    )
    assert result.exit_code == 2
    assert f"no folder '{tmp_path / 'nowhere'}' for the figures: create it first" in " ".join(
        result.output.split()
    )
