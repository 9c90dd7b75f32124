"""The benchmark works. All cases of our own contestants yield figures, which no test judges."""

import math
import re
from pathlib import Path

import msgspec
import pytest
from click.testing import CliRunner

from dev.benchmarks.messages.cases import (
    STAGES,
    TASK_PEERS,
    Case,
    Entry,
    Needs,
    Stage,
    chosen,
    quick_stages,
)
from dev.benchmarks.messages.command import bench
from dev.benchmarks.messages.results import Report, report_of
from dev.benchmarks.messages.running import Results, lacking, run
from dev.benchmarks.messages.table import number
from dev.benchmarks.speed_page import Aim, write

QUICK = ("--quick", "--rounds", "1", "--seconds", "0.001")


@pytest.mark.slow
@pytest.mark.soak
def test_benchmark_reports_figures_and_finite_ratios(tmp_path: Path) -> None:
    path = tmp_path / "figures.json"
    result = CliRunner().invoke(bench, [*QUICK, "--json", str(path)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    report = msgspec.json.decode(path.read_bytes(), type=Report)
    assert report.missing == {}
    assert [(table.stage, table.case, table.part) for table in report.tables] == [
        (stage.title, case.name, part)
        for stage in STAGES
        for case in stage.cases
        for part, _ in case.parts
    ]
    for table in report.tables:
        assert len(table.rows) + len(table.unable) >= 2, table.case
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


def test_contestant_without_a_counterpart_says_why() -> None:
    entry = Entry("Python", "own.costs", "Started", {"what": "python"})
    result = run(
        [Stage("any", (Case("round trip", "round_trip", arguments=(100,)),), (entry,), "")],
        1,
        0.001,
        print,
    )
    (table,) = report_of(result, 1, 0.001).tables
    assert (table.rows, table.unable) == ([], {"Python": "not measured"})


@pytest.mark.slow
def test_page_has_the_figures_of_a_results_file(tmp_path: Path) -> None:
    camera, round_trip, plain = (
        "a camera of 6 MB at 30 Hz",
        "round trip of 6 MB",
        "ZeroMQ, no broker",
    )
    stages = chosen(
        quick_stages(STAGES),
        lambda name: name in (camera, round_trip),
        lambda entry: entry.title in ("zmq.proxy", plain),
    )
    report = report_of(run(stages, 2, 0.001, print), 2, 0.001)
    results = tmp_path / "figures.json"
    results.write_bytes(msgspec.json.encode(report))
    write(results, tmp_path)
    page = (tmp_path / "speed.md").read_text()
    for table in report.tables:
        for row in table.rows:
            assert re.search(f"[|] {row.contestant} [|].* {number(row.median)}[ (]", page), row
    assert f"| {plain} | no broker |" in page
    assert round_trip in (tmp_path / "speed-images.svg").read_text()
    table = next(one for one in report.tables if one.case == round_trip)
    ratio = number(next(one.ratio for one in table.rows if one.contestant == plain))
    assert f"at most 1e+09 | {ratio} | yes |" in str(Aim(round_trip, 1e9, plain).row(table))
    assert f"at most 0 | {ratio} | **no** |" in str(Aim(round_trip, 0, plain).row(table))
    assert Aim(round_trip, 1).row(table) is None


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
