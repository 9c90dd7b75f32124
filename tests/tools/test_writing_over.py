"""All commands that write files do so in the same way: over what they have made themselves, and over nothing else."""

import shutil
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result
from tools.story import stumbling

from tca_tools.export.__main__ import export
from tca_tools.gantt.__main__ import gantt
from tca_tools.report.__main__ import report
from tca_tools.tasktree_viz.__main__ import tree

COMMANDS = [
    (report, "run.html"),
    *((gantt, f"run.{kind}") for kind in ("svg", "png", "pdf", "html", "txt")),
    *((tree, f"run.{kind}") for kind in ("svg", "txt", "dot")),
    *((export, f"run.{kind}") for kind in ("pftrace", "mcap", "jsonl")),
]


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return stumbling().write(tmp_path / "run")


def written(command: Any, run: Path, output: Path, *more: str) -> Result:
    if output.suffix in (".png", ".pdf", ".svg") and command is tree and shutil.which("dot") is None:
        more = (*more, "--layout", "outline")
    return CliRunner().invoke(command, [str(run), "-o", str(output), *more])


@pytest.mark.parametrize(("command", "name"), COMMANDS)
def test_what_a_command_has_made_it_makes_anew_and_what_is_of_others_stays(
    command: Any, name: str, run: Path, tmp_path: Path
) -> None:
    output = tmp_path / name
    output.write_bytes(b"")  # nothing is lost with it
    assert written(command, run, output).exit_code == 0
    first = output.read_bytes()
    assert written(command, run, output).exit_code == 0
    assert abs(len(output.read_bytes()) - len(first)) < 200  # pictures may tell when they were made
    output.write_text("<html>precious</html>")
    result = written(command, run, output)
    assert result.exit_code == 1
    said = "exists already, and was not made by this command: give another name, or --force"
    assert said in str(result.exception) + result.stderr
    assert output.read_text() == "<html>precious</html>"
    assert written(command, run, output, "--force").exit_code == 0
    assert "precious" not in output.read_text(errors="replace")


@pytest.mark.parametrize("name", ["csv", "parquet"])
def test_tables_go_over_tables_and_beside_all_else(name: str, run: Path, tmp_path: Path) -> None:
    folder = tmp_path / "tables"
    for _ in range(2):
        assert written(export, run, folder, "--to", name).exit_code == 0
    (folder / "notes.txt").write_text("mine")
    (folder / f"tasks.{name}").write_text("mine, too")
    result = written(export, run, folder, "--to", name)
    assert (result.exit_code, (folder / f"tasks.{name}").read_text()) == (1, "mine, too")
    assert written(export, run, folder, "--to", name, "--force").exit_code == 0
    assert (folder / "notes.txt").read_text() == "mine"


@pytest.mark.parametrize("name", ["csv", "jsonl"])
def test_a_name_that_is_too_long_is_said(name: str, run: Path, tmp_path: Path) -> None:
    result = written(export, run, tmp_path / ("a" * 300), "--to", name)
    assert (result.exit_code, "can't be written: File name too long" in result.stderr) == (1, True)


def test_a_journal_is_never_written_over(run: Path) -> None:
    segment = run / "00000001.tcaj"
    before = segment.read_bytes()
    for output, name in ((segment, "jsonl"), (run, "csv"), (segment, "csv"), (run, "jsonl")):
        result = written(export, run, output, "--to", name, "--force")
        assert result.exit_code == 1
    assert segment.read_bytes() == before
    assert [path.name for path in run.iterdir()] == ["00000001.tcaj"]
