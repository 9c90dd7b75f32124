"""``tca export``, its tables, and the rules for output files of all commands."""

import csv
import io
import json
import shutil
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from click.testing import CliRunner, Result
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from pyarrow import parquet
from tools.story import Story, locking, made, silent_for, stuck, stumbling, walking
from tools.test_history import FACTS
from tools.trace_reader import read_trace

from tca_tools.export.__main__ import FORMATS, export
from tca_tools.export.parquet_files import write_parquet
from tca_tools.export.tables import TABLES, ColumnType, write_csv
from tca_tools.gantt.__main__ import gantt
from tca_tools.journal.fold import History
from tca_tools.log.__main__ import log
from tca_tools.report.__main__ import report
from tca_tools.stats.__main__ import stats
from tca_tools.tasktree_viz.__main__ import tree
from tca_wire.journal import facts
from tca_wire.journal.facts import JOURNAL_VERSION, Entry
from tca_wire.journal.records import record
from tca_wire.points import Moment, TaskId


def rows(history: History, name: str) -> list[dict[str, Any]]:
    table = next(table for table in TABLES if table.name == name)
    return [dict(zip(table.columns, row, strict=True)) for row in table.rows(history)]


def test_tables_match_their_transcript(expect: Callable[[str, str], None]) -> None:
    text = io.BytesIO()
    for story in (stumbling(), locking()):
        for table in TABLES:
            text.write(f"--- {table.name}\n".encode())
            write_csv(table, story.fold(), text)
    expect("tables", text.getvalue().decode().replace("\r\n", "\n"))


def odd() -> History:
    """Return a run whose names and texts have quotes, line ends and control characters."""
    story = Story().at(1.0)
    task = story.goal('a "quoted", name\nof lines', "süß\x1b[31m", data={"text": 'x,"y"\n'})
    return story.at(2.0).say(facts.Killed(TaskId(task), "")).reached(task, *Moment).fold()


@pytest.mark.parametrize("history", [stumbling().fold(), odd()])
def test_csv_and_parquet_hold_the_same_rows(history: History) -> None:
    for table in TABLES:
        text, typed = io.BytesIO(), io.BytesIO()
        write_csv(table, history, text)
        write_parquet(table, history, typed)
        expected = [dict(zip(table.columns, row, strict=True)) for row in table.rows(history)]
        assert parquet.read_table(io.BytesIO(typed.getvalue())).to_pylist() == expected
        lines = list(csv.DictReader(io.StringIO(text.getvalue().decode(), newline="")))
        assert [
            {name: read(kind, line[name]) for name, kind in table.columns.items()} for line in lines
        ] == [
            {name: None if value == "" else value for name, value in row.items()}
            for row in expected
        ]


def test_parquet_clamps_integers_beyond_63_bits() -> None:
    """A module may send any origin and any priority."""
    story, most = Story().module("legs", "move").at(1.0), (1 << 64) - 1
    move = story.command("move", "user", origin=most)
    for table, column in (("messages", "origin"), ("queueings", "priority")):
        history = story.say(facts.Queued(move, move, "legs", "", most)).fold()
        typed = io.BytesIO()
        write_parquet(next(one for one in TABLES if one.name == table), history, typed)
        assert parquet.read_table(typed)[column].to_pylist()[-1] == (1 << 63) - 1


def read(kind: ColumnType, text: str) -> Any:
    """Return the value of a CSV cell."""
    make: dict[ColumnType, Callable[[str], Any]] = {
        ColumnType.INTEGER: int,
        ColumnType.SECONDS: float,
        ColumnType.FLAG: lambda word: {"true": True, "false": False}[word],
    }
    return make.get(kind, str)(text) if text else None


# --- formats, folders and errors ------------------------------------------------------------------


def exported(*arguments: object) -> Result:
    return CliRunner().invoke(export, [str(argument) for argument in arguments])


def test_format_follows_from_the_output_suffix(run: Path, tmp_path: Path) -> None:
    assert exported(run, "-o", tmp_path / "run.jsonl").exit_code == 0
    shown = CliRunner().invoke(log, ["show", str(run), "--json"]).output
    assert (tmp_path / "run.jsonl").read_text() == shown
    assert json.loads(shown.splitlines()[0])["kind"] == "opened"
    result = exported(run, "-o", tmp_path / "run.json")
    assert result.exit_code == 2
    assert "its suffix is that of no format: add --to with one of perfetto, mcap" in result.stderr
    for name in ("csv", "parquet"):
        result = exported(run, "-o", tmp_path / f"x.{name}")
        assert result.exit_code == 2
        refusal = f"{name} is a folder of tables, not a file: name the folder: --to {name} -o {tmp_path / 'x'}\n"
        assert refusal in result.stderr
        assert not (tmp_path / f"x.{name}").exists()
    assert "'xml' is not one of" in exported(run, "--to", "xml", "-o", tmp_path / "x").stderr


def test_unwritable_output_is_reported(run: Path, tmp_path: Path) -> None:
    for name in ("jsonl", "csv"):
        result = exported(run, "--to", name, "-o", tmp_path / "nowhere" / "out")
        assert result.exit_code == 1
        assert "No such file or directory" in result.stderr
    (tmp_path / "folder").mkdir()
    result = exported(run, "--to", "jsonl", "-o", tmp_path / "folder", "--force")
    assert "folder: can't be written: Is a directory" in result.stderr
    (tmp_path / "file").write_text("")
    assert (
        "can't be written"
        in exported(run, "--to", "csv", "-o", tmp_path / "file", "--force").stderr
    )


@pytest.mark.parametrize("name", ["jsonl", "csv"])
def test_export_refuses_to_replace_a_device(run: Path, tmp_path: Path, name: str) -> None:
    """The export would replace the device by a file. The test uses a link to a device."""
    output = tmp_path / "device"
    output.symlink_to("/dev/null")
    result = exported(run, "--to", name, "-o", output, "--force")
    assert result.exit_code == 1
    assert f"{output}: neither a file nor a folder: give another name" in result.stderr
    assert output.is_char_device()


@given(st.lists(FACTS, max_size=60))
@settings(max_examples=6)
def test_arbitrary_facts_are_exported_and_measured(arbitrary: list[facts.Fact]) -> None:
    """A foreign program may have written the journal."""
    arbitrary = [
        fact for fact in arbitrary if not isinstance(fact, facts.Opened)
    ]  # reading ends where another run begins
    opening = facts.Opened(JOURNAL_VERSION, "e", 1, 0.0, "0.1.0")
    entries = [
        Entry(0, 0.0, [opening]),
        *(Entry(number, number // 3, [fact]) for number, fact in enumerate(arbitrary, 1)),
    ]
    with TemporaryDirectory() as folder:
        run = Path(folder) / "00000001.tcaj"
        try:
            run.write_bytes(b"".join(map(record, entries)))
        except OverflowError:
            assume(False)  # no journal can have such a number
        for name in FORMATS:
            assert exported(run, "--to", name, "-o", Path(folder) / name).output == ""
        assert CliRunner().invoke(stats, [str(run)]).exit_code == 0
        read_trace((Path(folder) / "perfetto").read_bytes(), is_nonsense=True)


@pytest.mark.parametrize(
    ("name", "content", "complaint"), [("csv", b"", "empty"), ("mcap", b"foreign", "not a journal")]
)
def test_invalid_journal_leaves_no_output(
    tmp_path: Path, name: str, content: bytes, complaint: str
) -> None:
    path = tmp_path / "00000001.tcaj"
    path.write_bytes(content)
    result = exported(path, "--to", name, "-o", tmp_path / "out")
    assert result.exit_code == 2
    assert complaint in result.stderr
    assert [found.name for found in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("name", FORMATS)
def test_empty_and_partial_runs_export_in_every_format(tmp_path: Path, name: str) -> None:
    assert (
        exported(Story().write(tmp_path / "quiet"), "--to", name, "-o", tmp_path / "one").exit_code
        == 0
    )
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
def test_missing_export_package_is_named_with_its_extra(
    run: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    module: str,
    imported: str,
    extra: str,
) -> None:
    monkeypatch.setitem(sys.modules, imported, None)
    monkeypatch.delitem(sys.modules, f"tca_tools.export.{module}", raising=False)
    result = exported(run, "--to", name, "-o", tmp_path / "out")
    assert result.exit_code == 1
    assert f"needs the Python package '{imported.partition('.')[0]}': pip" in result.stderr
    assert f"pip install 'tca-central[{extra}]'" in result.stderr


def test_failed_export_leaves_no_partial_file(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> Callable[..., None]:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("tca_tools.export.__main__.fact_row", full)
    result = exported(run, "-o", tmp_path / "run.jsonl")
    assert "run.jsonl: can't be written: No space left on device" in result.stderr
    assert [found.name for found in tmp_path.iterdir()] == ["run"]


# --- live runs without new entries ----------------------------------------------------------------


Tca = Callable[..., Result]
NOW = 44.0
"""Seconds: long after the last entry of the walk, at 4 s."""


@pytest.fixture
def quiet(tmp_path: Path) -> Path:
    return walking().write(tmp_path / "run")


def table(folder: Path, name: str) -> list[dict[str, Any]]:
    with (folder / f"{name}.csv").open() as stream:
        return list(csv.DictReader(stream))


def test_trace_of_a_live_run_lasts_until_now(tca: Tca, quiet: Path, tmp_path: Path) -> None:
    with silent_for(quiet, NOW - 4.0):
        assert not tca("export", quiet, "-o", tmp_path / "live.pftrace").exit_code
    (here,) = read_trace((tmp_path / "live.pftrace").read_bytes()).on("run")
    assert here.name == "still running"
    assert here.start >= NOW * 1e9
    assert here.details == {"last entry": 4.0}
    assert not tca("export", quiet, "-o", tmp_path / "over.pftrace").exit_code
    assert not read_trace((tmp_path / "over.pftrace").read_bytes()).on("run")


def test_mcap_file_of_a_live_run_lasts_until_now(tca: Tca, quiet: Path, tmp_path: Path) -> None:
    with silent_for(quiet, NOW - 4.0):
        assert not tca("export", quiet, "-o", tmp_path / "run.mcap").exit_code
    with (tmp_path / "run.mcap").open("rb") as stream:
        reader = make_reader(stream)
        summary, (*_, (_, channel, last)) = reader.get_summary(), reader.iter_messages()
    assert channel.topic == "/tca/log"
    assert json.loads(last.data)["message"] == "still running: nothing has happened since 4.000 s"
    assert summary is not None
    assert summary.statistics is not None
    assert (
        summary.statistics.message_end_time - summary.statistics.message_start_time
    ) / 1e9 >= NOW


def test_run_table_has_the_end_time_and_liveness(tca: Tca, quiet: Path, tmp_path: Path) -> None:
    with silent_for(quiet, NOW - 4.0):
        assert not tca("export", quiet, "--to", "csv", "-o", tmp_path / "live").exit_code
    (live,) = table(tmp_path / "live", "run")
    assert (live["last"], live["live"]) == ("4.0", "true")
    assert float(live["until"]) >= NOW
    assert not tca("export", quiet, "--to", "csv", "-o", tmp_path / "over").exit_code
    (over,) = table(tmp_path / "over", "run")
    assert (over["last"], over["until"], over["live"]) == ("4.0", "4.0", "false")


@pytest.mark.parametrize("command", ["gantt", "tree"])
def test_tree_and_gantt_files_mark_a_live_run(
    tca: Tca, quiet: Path, tmp_path: Path, command: str
) -> None:
    out = tmp_path / "run.txt"
    with silent_for(quiet, NOW - 4.0):
        assert not tca(command, quiet, "-o", out).exit_code
        title = out.read_text().splitlines()[0]
        assert "(still running)" in title
        assert tca(command, quiet, "--at", 1.0).stdout.count("still running") == 0
    assert float(title.partition(" s (still")[0].split()[-1]) >= NOW
    assert not tca(command, quiet, "-o", out).exit_code
    assert "still running" not in out.read_text()


def test_chart_of_an_idle_live_run_ends_with_the_last_task(tca: Tca, tmp_path: Path) -> None:
    idle = Story().module("legs", "move").at(1.0)
    idle.acted(idle.command("move", "user"), "legs", 1.0)
    run = idle.write(tmp_path / "idle")
    with silent_for(run, 100.0):
        assert "0.98 to 2.02 s" in tca("gantt", run).stdout
    assert "0.98 to 2.00 s" in tca("gantt", run).stdout


@pytest.mark.parametrize("tale", [partial(made, "wondering"), stuck, stumbling])
def test_closed_journal_is_shown_like_an_open_one(
    tale: Callable[[], Story], tca: Tca, tmp_path: Path
) -> None:
    logs = [
        tale().at(20.0).say(*ended).write(tmp_path / name / "run")
        for name, ended in (("open", ()), ("closed", [facts.Closed("interrupted")]))
    ]
    first = min(tale().fold().tasks)
    for command in (["tree"], ["tree", "--story", first], ["gantt"], ["stats"]):
        there, closed = (tca(*command[:1], one, *command[1:]) for one in logs)
        assert there.exit_code == closed.exit_code == 0, closed.stderr
        assert closed.stdout == there.stdout
    for one in logs:
        assert tca("export", one, "-o", one.parent / "tables", "--to", "csv").exit_code == 0
    names = {path.name for path in (tmp_path / "open" / "tables").iterdir()}
    assert "messages.csv" in names
    for name in names - {"facts.csv", "events.csv"}:
        assert (tmp_path / "closed" / "tables" / name).read_text() == (
            tmp_path / "open" / "tables" / name
        ).read_text()


def test_closed_run_still_shows_its_unmet_wait(tca: Tca, tmp_path: Path) -> None:
    log = made("wondering").at(80.0).say(facts.Closed("interrupted")).write(tmp_path / "run")
    assert (
        "waits for the reply to ask supplier {2} (no module handles it), for 78 s"
        in tca("tree", log).stdout
    )


# --- commands replace their own files only --------------------------------------------------------


COMMANDS = [
    (report, "run.html"),
    *((gantt, f"run.{kind}") for kind in ("svg", "png", "pdf", "html", "txt")),
    *((tree, f"run.{kind}") for kind in ("svg", "txt", "dot")),
    *((export, f"run.{kind}") for kind in ("pftrace", "mcap", "jsonl")),
]


def written(command: Any, run: Path, output: Path, *more: str) -> Result:
    if (
        output.suffix in (".png", ".pdf", ".svg")
        and command is tree
        and shutil.which("dot") is None
    ):
        more = (*more, "--layout", "outline")
    return CliRunner().invoke(command, [str(run), "-o", str(output), *more])


@pytest.mark.parametrize(("command", "name"), COMMANDS)
def test_command_replaces_only_files_it_has_made(
    command: Any, name: str, run: Path, tmp_path: Path
) -> None:
    output = tmp_path / name
    output.write_bytes(b"")  # an empty file may be replaced
    assert written(command, run, output).exit_code == 0
    first = output.read_bytes()
    assert written(command, run, output).exit_code == 0
    assert abs(len(output.read_bytes()) - len(first)) < 200  # pictures may contain their date
    output.write_text("<html>precious</html>")
    result = written(command, run, output)
    assert result.exit_code == 1
    refusal = "exists already, and was not made by this command: give another name, or --force"
    assert refusal in str(result.exception) + result.stderr
    assert output.read_text() == "<html>precious</html>"
    assert written(command, run, output, "--force").exit_code == 0
    assert "precious" not in output.read_text(errors="replace")


@pytest.mark.parametrize("name", ["csv", "parquet"])
def test_table_export_replaces_only_its_own_tables(name: str, run: Path, tmp_path: Path) -> None:
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
def test_too_long_export_name_is_reported(name: str, run: Path, tmp_path: Path) -> None:
    result = written(export, run, tmp_path / ("a" * 300), "--to", name)
    assert (result.exit_code, "can't be written: File name too long" in result.stderr) == (1, True)


def test_export_never_replaces_a_journal(run: Path) -> None:
    segment = run / "00000001.tcaj"
    before = segment.read_bytes()
    for output, name in ((segment, "jsonl"), (run, "csv"), (segment, "csv"), (run, "jsonl")):
        result = written(export, run, output, "--to", name, "--force")
        assert result.exit_code == 1
    assert segment.read_bytes() == before
    assert [path.name for path in run.iterdir()] == ["00000001.tcaj"]
