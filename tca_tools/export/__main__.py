"""``tca export``: a run as a file, or a folder of files, for other tools."""

from collections.abc import Callable
from itertools import count, islice
from pathlib import Path
from typing import BinaryIO, NamedTuple

import click

from tca_tools.errors import ToolError, extra
from tca_tools.export.images import data_folder
from tca_tools.export.tables import TABLES, Table, write_csv
from tca_tools.journal.fold import folded
from tca_tools.journal.journals import Log, open_log
from tca_tools.journal.whole_run import Run
from tca_tools.log.fact_rows import fact_row
from tca_tools.options import force_option, log_argument
from tca_tools.output import check_free, new_file, writing
from tca_wire.journal.records import SEGMENT_SUFFIX
from tca_wire.text.bodies import json_text


class ExportFormat(NamedTuple):
    """A format of exports."""

    suffixes: tuple[str, ...]
    """The suffixes of its files; none for a folder."""
    write: Callable[[Log, Path], None]
    begins: bytes = b""
    """The first bytes of its files, by which an earlier export is recognised.

    If empty, these are the names of a table's columns.
    """
    tables: str = ""
    """The suffix of the files in a folder of tables."""


def _perfetto(journal: Log, output: Path) -> None:
    with extra("exports", "this export"):
        from tca_tools.export.trace.packets import write_trace  # noqa: PLC0415
    run = folded(journal)
    with new_file(output) as stream:
        write_trace(run, stream)


def _mcap(journal: Log, output: Path) -> None:
    with extra("exports", "this export"):
        from tca_tools.export.mcap_file import write_mcap  # noqa: PLC0415
    number = count()
    run = folded(journal, entries=(entry for entry, _ in zip(journal, number, strict=False)))
    # The second reading stops at the same entry, although a live run may have more entries by now.
    same_entries = islice(Log(journal.path), next(number))
    with new_file(output) as stream:
        write_mcap(run, same_entries, stream, data_folder(journal.path, run.epoch))


def _json_lines(journal: Log, output: Path) -> None:
    with new_file(output) as stream:
        for entry in journal:
            stream.writelines(
                json_text(fact_row(entry, fact)).encode() + b"\n" for fact in entry.facts
            )


def _csv(journal: Log, output: Path) -> None:
    _tables(folded(journal), output, ".csv", write_csv)


def _parquet(journal: Log, output: Path) -> None:
    with extra("parquet", "this export"):
        from tca_tools.export.parquet_files import write_parquet  # noqa: PLC0415
    _tables(folded(journal), output, ".parquet", write_parquet)


def _tables(
    run: Run, output: Path, suffix: str, write: Callable[[Table, Run, BinaryIO], None]
) -> None:
    with writing(output):
        output.mkdir(exist_ok=True)
    for table in TABLES:
        with new_file(output / f"{table.name}{suffix}") as stream:
            write(table, run, stream)


FORMATS = {
    "perfetto": ExportFormat((".pftrace", ".perfetto-trace"), _perfetto, b"\n"),
    "mcap": ExportFormat((".mcap",), _mcap, b"\x89MCAP0\r\n"),
    "jsonl": ExportFormat((".jsonl",), _json_lines, b'{"t": '),
    "csv": ExportFormat((), _csv, tables=".csv"),
    "parquet": ExportFormat((), _parquet, b"PAR1", ".parquet"),
}


@click.command()
@log_argument
@click.option(
    "--to",
    "name",
    type=click.Choice(list(FORMATS)),
    help="The format (default: by the file's suffix).",
)
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path),
    help="The file; for tables, the folder.",
)
@force_option
def export(log_path: Path | None, name: str | None, output: Path, *, force: bool) -> None:
    """Write a run for other tools.

    \b
    perfetto  ui.perfetto.dev: modules, queues, arrows between them, task tree (.pftrace)
    mcap      Foxglove and others: a topic for each message (.mcap)
    jsonl     all facts, one JSON object a line (.jsonl)
    csv       a folder of tables: messages, tasks, states, handlings, queueings, waits, ...
    parquet   the same tables with typed columns
    """  # noqa: D301 - click interprets the character itself
    chosen = FORMATS[name or _named_by(output)]
    _check_free(chosen, output, force=force)
    journal = open_log(log_path)
    chosen.write(journal, output)
    journal.check()


def _check_free(chosen: ExportFormat, output: Path, *, force: bool) -> None:
    """Raise ToolError if the export would overwrite anything but an earlier export."""
    with writing(output):
        is_file = not chosen.tables or (output.exists() and not output.is_dir())
    if is_file:
        check_free(output, begins=chosen.begins, force=force)
        return
    if any(output.glob(f"*{SEGMENT_SUFFIX}")):
        raise ToolError(f"{output} is a journal: choose another folder")
    for table in TABLES:
        begins = chosen.begins or ",".join(table.columns).encode()
        check_free(output / f"{table.name}{chosen.tables}", begins=begins, force=force)


def _named_by(output: Path) -> str:
    """Return the format with the file's suffix; raise UsageError if there is none."""
    for name, known in FORMATS.items():
        if output.suffix in known.suffixes:
            return name
        if output.suffix and output.suffix == known.tables:
            folder = output.with_suffix("")
            raise click.UsageError(
                f"{output}: {name} is a folder of tables, not a file: "
                f"name the folder: --to {name} -o {folder}"
            )
    raise click.UsageError(
        f"{output}: its suffix is that of no format: add --to with one of {', '.join(FORMATS)}"
    )


if __name__ == "__main__":
    export(prog_name="python -m tca_tools.export")
