"""``tca export``: formats, folders, and what is said when it can't be done."""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from click.testing import CliRunner, Result
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from tools.story import Story, stumbling
from tools.test_history import FACTS
from tools.trace_reader import read_trace

from tca_tools.export.__main__ import FORMATS, export
from tca_tools.log.__main__ import log
from tca_tools.stats.__main__ import stats
from tca_wire.journal import facts
from tca_wire.journal.facts import JOURNAL_VERSION, Entry
from tca_wire.journal.records import record


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return stumbling().write(tmp_path / "run", segments=2)


def exported(*arguments: object) -> Result:
    return CliRunner().invoke(export, [str(argument) for argument in arguments])


def test_the_name_tells_the_format(run: Path, tmp_path: Path) -> None:
    assert exported(run, "-o", tmp_path / "run.jsonl").exit_code == 0
    shown = CliRunner().invoke(log, ["show", str(run), "--json"]).output
    assert (tmp_path / "run.jsonl").read_text() == shown
    assert json.loads(shown.splitlines()[0])["kind"] == "opened"
    result = exported(run, "-o", tmp_path / "run.json")
    assert result.exit_code == 2
    assert "its name tells no format: add --to with one of perfetto, mcap" in result.stderr
    for name in ("csv", "parquet"):
        result = exported(run, "-o", tmp_path / f"x.{name}")
        assert result.exit_code == 2
        said = f"{name} is no single file but a folder of tables: name the folder: --to {name} -o {tmp_path / 'x'}\n"
        assert said in result.stderr
        assert not (tmp_path / f"x.{name}").exists()
    assert "'xml' is not one of" in exported(run, "--to", "xml", "-o", tmp_path / "x").stderr


def test_what_cant_be_written_is_said(run: Path, tmp_path: Path) -> None:
    for name in ("jsonl", "csv"):
        result = exported(run, "--to", name, "-o", tmp_path / "nowhere" / "out")
        assert result.exit_code == 1
        assert "No such file or directory" in result.stderr
    (tmp_path / "folder").mkdir()
    result = exported(run, "--to", "jsonl", "-o", tmp_path / "folder", "--force")
    assert "folder: can't be written: Is a directory" in result.stderr
    (tmp_path / "file").write_text("")
    assert "can't be written" in exported(run, "--to", "csv", "-o", tmp_path / "file", "--force").stderr


@pytest.mark.parametrize("name", ["jsonl", "csv"])
def test_a_device_is_not_written_over(run: Path, tmp_path: Path, name: str) -> None:
    """Of a device the export would become the file; what is tried here is a name that leads to one."""
    output = tmp_path / "device"
    output.symlink_to("/dev/null")
    result = exported(run, "--to", name, "-o", output, "--force")
    assert result.exit_code == 1
    assert f"{output}: neither a file nor a folder: give another name" in result.stderr
    assert output.is_char_device()


@given(st.lists(FACTS, max_size=60))
@settings(max_examples=12)
def test_any_facts_at_all_are_exported_and_measured(told: list[facts.Fact]) -> None:
    """What a foreign program has written as a journal: nonsense perhaps, but exported without a stumble."""
    told = [fact for fact in told if not isinstance(fact, facts.Opened)]  # where another run begins reading ends
    opening = facts.Opened(JOURNAL_VERSION, "e", 1, 0.0, "0.1.0")
    entries = [Entry(0, 0.0, [opening]), *(Entry(number, number // 3, [fact]) for number, fact in enumerate(told, 1))]
    with TemporaryDirectory() as folder:
        run = Path(folder) / "00000001.tcaj"
        try:
            run.write_bytes(b"".join(map(record, entries)))
        except OverflowError:
            assume(False)  # no journal can have such a number
        for name in FORMATS:
            assert exported(run, "--to", name, "-o", Path(folder) / name).output == ""
        assert CliRunner().invoke(stats, [str(run)]).exit_code == 0
        read_trace(Path(folder) / "perfetto", is_nonsense=True)


@pytest.mark.parametrize(
    ("name", "content", "complaint"), [("csv", b"", "empty"), ("mcap", b"foreign", "not a journal")]
)
def test_of_no_journal_nothing_is_written(tmp_path: Path, name: str, content: bytes, complaint: str) -> None:
    path = tmp_path / "00000001.tcaj"
    path.write_bytes(content)
    result = exported(path, "--to", name, "-o", tmp_path / "out")
    assert result.exit_code == 2
    assert complaint in result.stderr
    assert [found.name for found in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("name", FORMATS)
def test_a_run_in_which_nothing_happened_and_one_that_begins_in_the_middle(tmp_path: Path, name: str) -> None:
    assert exported(Story().write(tmp_path / "quiet"), "--to", name, "-o", tmp_path / "one").exit_code == 0
    run = stumbling().write(tmp_path / "run", segments=3)
    assert exported(run / "00000003.tcaj", "--to", name, "-o", tmp_path / "two").exit_code == 0


@pytest.mark.parametrize(
    ("name", "module", "imported", "extra"),
    [
        ("perfetto", "trace.packets", "perfetto.trace_builder.proto_builder", "exports"),
        ("mcap", "mcap_file", "mcap.writer", "exports"),
        ("parquet", "parquet_files", "pyarrow", "parquet"),
    ],
)
def test_a_missing_package_is_named(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, module: str, imported: str, extra: str
) -> None:
    monkeypatch.setitem(sys.modules, imported, None)
    monkeypatch.delitem(sys.modules, f"tca_tools.export.{module}", raising=False)
    result = exported(run, "--to", name, "-o", tmp_path / "out")
    assert result.exit_code == 1
    assert f"the Python package '{imported.partition('.')[0]}' can't be loaded" in result.stderr
    assert f"pip install 'tca-central[{extra}]'" in result.stderr


def test_files_that_cant_be_finished_leave_nothing(run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> Callable[..., None]:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("tca_tools.export.__main__.fact_row", full)
    result = exported(run, "-o", tmp_path / "run.jsonl")
    assert "run.jsonl: can't be written: No space left on device" in result.stderr
    assert [found.name for found in tmp_path.iterdir()] == ["run"]
