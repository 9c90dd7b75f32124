"""A run as tables for CSV and Parquet files; columns.py describes the columns for users.

Times are seconds on the journal's clock. None stands for a value that is unknown, has not occurred
yet, or does not exist.
"""

import csv
import io
from collections.abc import Callable, Iterator
from enum import StrEnum
from itertools import chain, pairwise
from math import inf
from typing import Any, BinaryIO

from tca_tools.explain.waits import Wait, of_handler_wait, waits_of
from tca_tools.export.columns import COLUMNS
from tca_tools.journal.fates import all_failures, fate, run_continued, run_continued_after
from tca_tools.journal.records import HandlerWait, Handling, Queueing
from tca_tools.journal.whole_run import Run
from tca_wire.points import MOMENTS, describe_moments
from tca_wire.text.bodies import json_text, plain_data
from tca_wire.vocabulary import Outcome
from tca_wire.waits import WaitKind


class ColumnType(StrEnum):
    """The type of a column."""

    TEXT = ""
    INTEGER = "int"
    SECONDS = "s"
    FLAG = "flag"
    JSON = "json"


TableRow = tuple[Any, ...]


class Table:
    """A table: its name, a function that yields its rows, and its columns.

    Attributes:
        meaning: what the rows are.
        columns: the columns with their types.
        meanings: the columns with their meanings.
    """

    def __init__(self, name: str, rows: Callable[[Run], Iterator[TableRow]]) -> None:
        self.name = name
        self.rows = rows
        self.meaning, text = COLUMNS[name]
        self.columns: dict[str, ColumnType] = {}
        self.meanings: dict[str, str] = {}
        for line in text.strip().splitlines():
            head, meaning = line.split(maxsplit=1)
            column, _, word = head.partition(":")
            self.columns[column], self.meanings[column] = ColumnType(word), meaning


def _run(run: Run) -> Iterator[TableRow]:
    first, last = (run.clock[0], run.clock[-1]) if run.clock else (None, None)
    yield (
        run.epoch or None,
        run.began,
        first,
        last,
        max(run.time, last or 0.0),
        run.is_live,
        len(run.times),
    )


def _messages(run: Run) -> Iterator[TableRow]:
    for message in run.messages.values():
        handlings = message.handlings
        is_handled = None
        if message.failure:
            is_handled = run_continued(run, message, message.written_at("failure"))
        yield (
            message.id, message.name, str(message.message_class),
            message.sender, message.origin or None, str(message.role) or None,
            message.about or None, message.received,
            handlings[0].start if handlings else None, handlings[-1].end if handlings else None,
            message.answered, len(handlings), message.failure or None, is_handled,
            message.dropped or None, _json(message.body), _json(message.result),
            _json(message.failure_data),
        )  # fmt: skip


def _failures(run: Run) -> Iterator[TableRow]:
    for one in all_failures(run):
        yield (
            one.message.id,
            one.message.name,
            one.time,
            one.failure.name,
            one.failure.words or None,
            one.by or None,
            _delivery(one.asker),
            str(fate(run, one.message, one.time)),
            run_continued(run, one.message, one.time),
        )


def _delivery(handling: Handling | None) -> int | None:
    return handling.delivery or None if handling else None


def _tasks(run: Run) -> Iterator[TableRow]:
    depths: dict[int, int] = {}
    for task in run.tasks.values():
        depths[task.id] = depths.get(task.parent, 0) + 1
        reached = [task.reached.get(moment) for moment in MOMENTS]
        known = (task.id, task.name, task.parent, depths[task.id], str(task.state))
        killed = (
            task.killed,
            task.killed_by or None,
            _delivery(task.killer),
            task.killed_for or None,
        )
        yield *known, *reached, *killed, task.suspension is not None


def _states(run: Run) -> Iterator[TableRow]:
    for task in run.tasks.values():
        for (start, state), (end, _) in pairwise(chain(task.states, [(None, None)])):
            yield task.id, task.name, str(state), start, end


def _changes(run: Run) -> Iterator[TableRow]:
    for task in run.tasks.values():
        for change in task.life:
            yield (
                task.id,
                task.name,
                change.time,
                change.transition,
                change.state,
                change.serial,
                str(change.by),
                change.module or None,
                change.text or None,
                _json(change.body),
            )


def _handlings(run: Run) -> Iterator[TableRow]:
    for handling in run.handlings:
        yield (
            handling.message_id, handling.delivery, handling.name,
            handling.module, handling.resource, handling.start, handling.end,
            handling.outcome and str(handling.outcome),
            run_continued_after(run, handling) if handling.outcome is Outcome.FAILED else None,
            handling.slot or None, handling.is_nested, handling.priority,
        )  # fmt: skip


def _queueings(run: Run) -> Iterator[TableRow]:
    for queueing in run.queueings:
        name = run.name(queueing.message_id)
        place = (queueing.module, queueing.resource)
        yield queueing.message_id, name, *place, queueing.priority, queueing.start, queueing.end


def _waits(run: Run) -> Iterator[TableRow]:
    found = [
        (message.id, wait)
        for message in run.messages.values()
        for wait in waits_of(run, message.id)
    ]
    found += [
        (0, of_handler_wait(run, wait)) for module in run.modules.values() for wait in module.waits
    ]
    for number, wait in sorted(found, key=lambda pair: pair[1].start):
        if wait.kind is not WaitKind.RUNNING:
            has_target = wait.kind not in (
                WaitKind.RESOURCE,
                WaitKind.HANDLER,
                WaitKind.DELAY,
                WaitKind.CONDITION,
            )
            on = (wait.on.number, run.name(wait.on.number)) if has_target else (None, None)
            moment = ", ".join(describe_moments(wait.on.moment * has_target)) or None
            yield (
                number or None,
                *_place(wait),
                str(wait.kind),
                *on,
                moment,
                wait.start,
                None if wait.end == inf else wait.end,
            )


def _place(wait: Wait) -> tuple[str | None, str | None, int | None]:
    """Return module, resource and delivery of the waiting handler, or of a message's queue."""
    record = wait.record.by if isinstance(wait.record, HandlerWait) else wait.record
    if isinstance(record, Handling | Queueing):
        return (
            record.module or None,
            record.resource or None,
            getattr(record, "delivery", 0) or None,
        )
    return record if isinstance(record, str) else None, None, None


def _drops(run: Run) -> Iterator[TableRow]:
    for drop in run.drops:
        yield (
            drop.time,
            drop.message_id,
            drop.name,
            drop.is_copy,
            str(drop.dropping) or None,
            drop.why,
        )


def _claims(run: Run) -> Iterator[TableRow]:
    for claim in run.claims.values():
        yield (
            claim.id,
            claim.module,
            claim.resource,
            claim.is_reserved,
            claim.sender,
            claim.origin or None,
            claim.start,
            claim.granted,
            claim.end,
            claim.ended or None,
        )


def _json(body: bytes) -> str | None:
    data = plain_data(body)
    return None if data is None else json_text(data)


TABLES = (
    Table("run", _run),
    Table("messages", _messages),
    Table("tasks", _tasks),
    Table("states", _states),
    Table("changes", _changes),
    Table("handlings", _handlings),
    Table("failures", _failures),
    Table("drops", _drops),
    Table("queueings", _queueings),
    Table("waits", _waits),
    Table("claims", _claims),
)
"""All tables."""


def write_csv(table: Table, run: Run, stream: BinaryIO) -> None:
    """Write a table as CSV (RFC 4180, UTF-8) with a line of column names; None is empty.

    Flags are "true" and "false", which readers of CSV recognise as truth values.
    """
    text = io.TextIOWrapper(stream, "utf-8", newline="")
    writer = csv.writer(text)
    writer.writerow(table.columns)
    for row in table.rows(run):
        writer.writerow(str(value).lower() if isinstance(value, bool) else value for value in row)
    text.detach()
