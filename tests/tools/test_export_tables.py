"""The tables of CSV and Parquet exports."""

import csv
import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pyarrow import parquet
from tools.story import Story, locking, stumbling
from tools.test_coping import asking, replacing

from tca_tools.export.parquet_files import write_parquet
from tca_tools.export.tables import TABLES, Kind, write_csv
from tca_tools.run.fold import History
from tca_wire.journal import facts
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import Outcome

DOCS = Path(__file__).parents[2] / "docs" / "exports.md"


def rows(history: History, name: str) -> list[dict[str, Any]]:
    table = next(table for table in TABLES if table.name == name)
    return [dict(zip(table.columns, row, strict=True)) for row in table.rows(history)]


def test_every_failure_has_a_row_with_what_became_of_it() -> None:
    history = asking(passed_on=True, task_fails=True, dealt_with=True).fold()
    told = [
        (row["message"], row["time"], row["failure"], row["text"], row["fate"]) for row in rows(history, "failures")
    ]
    assert told == [
        (3, 2.0, "blind", "fog", "coped"),
        (2, 3.0, "blind", "fog", "coped"),
        (1, 4.0, "blind", "fog", "recovered"),
    ]
    for name in ("failures", "messages", "handlings"):
        assert {
            row["handled"]
            for row in rows(history, name)
            if row.get("failure", row.get("outcome")) not in (None, "done")
        } == {True}
    lost = replacing(top_fails=True).fold()
    assert [row["handled"] for row in rows(lost, "failures")] == [False]
    assert [row["handled"] for row in rows(lost, "handlings")] == [False]


def test_all_tables(expect: Callable[[str, str], None]) -> None:
    direct = facts.HandledDirectly("where", "arm", "arm", "user", 0, 8, 1.5, 0.25, Outcome.FAILED, "dark")
    text = io.BytesIO()
    for story in (stumbling(), locking().say(direct)):
        for table in TABLES:
            text.write(f"--- {table.name}\n".encode())
            write_csv(table, story.fold(), text)
    expect("tables", text.getvalue().decode().replace("\r\n", "\n"))


def odd() -> History:
    """Names and texts that are hard on a format."""
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
        assert [{name: read(kind, line[name]) for name, kind in table.columns.items()} for line in lines] == [
            {name: None if value == "" else value for name, value in row.items()} for row in expected
        ]


def read(kind: Kind, text: str) -> Any:
    """What a program makes of a cell."""
    make: dict[Kind, Callable[[str], Any]] = {
        Kind.INTEGER: int,
        Kind.SECONDS: float,
        Kind.FLAG: lambda word: {"true": True, "false": False}[word],
    }
    return make.get(kind, str)(text) if text else None


def test_the_documentation_names_every_table_and_column() -> None:
    text = DOCS.read_text()
    for table in TABLES:
        part = text.split(f"### {table.name}\n", 1)[1].split("\n### ", 1)[0]
        for column in table.columns:
            assert f"`{column}`" in part, f"{table.name}: {column}"


def test_who_raised_a_failure_has_a_column() -> None:
    story = Story().module("legs", "move").at(1.0)
    slips, late, lost, old = (story.command("move", "user") for _ in range(4))
    for move in (slips, lost):
        story.delivered(move, "legs")
    story.at(2.0).failed(slips, "slip", "")
    story.at(3.0).say(facts.Failed(late, "timeout", "late", is_beside=True, by="central"))
    story.at(4.0).say(facts.Failed(late, "slip", "", is_beside=True, by="tca raise#7"))
    story.at(5.0).say(facts.Failed(lost, "module lost", "its connection closed"))
    story.at(6.0).say(facts.Failed(old, "slip", "", is_beside=True))
    told = [(row["message"], row["failure"], row["raised_by"]) for row in rows(story.fold(), "failures")]
    assert told == [
        (slips, "slip", "legs"),
        (late, "timeout", "central"),
        (late, "slip", "tca raise#7"),
        (lost, "module lost", "central"),
        (old, "slip", None),
    ]
