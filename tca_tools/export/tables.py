"""A run as tables: what CSV and Parquet files hold. Pure; docs/exports.md lists the columns for users.

Times are seconds on the journal's clock. None is what is not known, has not happened, or is not there.
"""

import json
from collections.abc import Callable, Iterator
from enum import StrEnum
from itertools import chain, pairwise
from math import inf
from typing import Any, NamedTuple

from tca_tools.run.failures import all_failures
from tca_tools.run.fates import fate, has_coped, went_on
from tca_tools.run.records import HandlerWait, Handling, Message, Queueing
from tca_tools.run.whole_run import Run
from tca_tools.why.waits import Wait, of_handler_wait, waits_of
from tca_wire.points import MOMENTS, describe_moments
from tca_wire.text.bodies import plain_data
from tca_wire.vocabulary import Outcome
from tca_wire.waits import WaitKind


class Kind(StrEnum):
    """The type of a column."""

    INTEGER = "integer"
    SECONDS = "seconds"
    TEXT = "text"
    FLAG = "flag"
    JSON = "json"


Row = tuple[Any, ...]


class Table(NamedTuple):
    """A name, columns with their kinds, and how the rows are made, oldest first."""

    name: str
    columns: dict[str, Kind]
    rows: Callable[[Run], Iterator[Row]]


def _run(run: Run) -> Iterator[Row]:
    first, last = (run.clock[0], run.clock[-1]) if run.clock else (None, None)
    yield run.epoch or None, run.began, first, last, max(run.time, last or 0.0), run.is_live, len(run.times)


def _messages(run: Run) -> Iterator[Row]:
    for message in run.messages.values():
        yield (
            message.id, message.name, str(message.message_class), message.sender, message.origin or None,
            str(message.role) or None, message.about or None, message.received, _started(message), _ended(message),
            message.answered, len(message.handlings), message.failure or None, _went_on(run, message),
            message.dropped or None,
            _json(message.body), _json(message.result), _json(message.failure_data),
        )  # fmt: skip


def _went_on(run: Run, message: Message) -> bool | None:
    """Whether the run went on after the failure that it has."""
    return went_on(run, message, message.written("failure")) if message.failure else None


def _failures(run: Run) -> Iterator[Row]:
    for one in all_failures(run):
        yield (
            one.message.id, one.message.name, one.time, one.failure.name, one.failure.words or None, one.by or None,
            _delivery(one.asker), str(fate(run, one.message, one.time)), went_on(run, one.message, one.time),
        )  # fmt: skip


def _delivery(handling: Handling | None) -> int | None:
    return handling.delivery or None if handling else None


def _started(message: Message) -> float | None:
    return message.handlings[0].start if message.handlings else None


def _ended(message: Message) -> float | None:
    return message.handlings[-1].end if message.handlings else None


def _tasks(run: Run) -> Iterator[Row]:
    depths: dict[int, int] = {}
    for task in run.tasks.values():
        depths[task.id] = depths.get(task.parent, 0) + 1
        reached = [task.reached.get(moment) for moment in MOMENTS]
        known = (task.id, task.name, task.parent, depths[task.id], str(task.state))
        killed = (task.killed, task.killed_by or None, _delivery(task.killer), task.killed_for or None)
        yield *known, *reached, *killed, task.suspension is not None


def _states(run: Run) -> Iterator[Row]:
    for task in run.tasks.values():
        for (start, state), (end, _) in pairwise(chain(task.states, [(None, None)])):
            yield task.id, task.name, str(state), start, end


def _handlings(run: Run) -> Iterator[Row]:
    for handling in run.handlings:
        yield (
            handling.message_id or None, handling.delivery or None, handling.name, handling.module, handling.resource,
            handling.start, handling.end, handling.outcome and str(handling.outcome),
            has_coped(run, handling) if handling.outcome is Outcome.FAILED else None, handling.direct_from or None,
            handling.slot or None, handling.is_nested, handling.priority,
        )  # fmt: skip


def _queueings(run: Run) -> Iterator[Row]:
    for queueing in run.queueings:
        name = run.name(queueing.message_id)
        where = (queueing.module, queueing.resource)
        yield queueing.message_id, name, *where, queueing.priority, queueing.start, queueing.end


def _waits(run: Run) -> Iterator[Row]:
    found = [(message.id, wait) for message in run.messages.values() for wait in waits_of(run, message.id)]
    found += [(0, of_handler_wait(run, wait)) for module in run.modules.values() for wait in module.waits]
    for number, wait in sorted(found, key=lambda one: one[1].start):
        if wait.kind is not WaitKind.RUNNING:
            is_other = wait.kind not in (WaitKind.RESOURCE, WaitKind.HANDLER, WaitKind.DELAY, WaitKind.CONDITION)
            on = (wait.on.number, run.name(wait.on.number)) if is_other else (None, None)
            moment = ", ".join(describe_moments(wait.on.moment)) if is_other and wait.on.moment else None
            yield (
                number or None, *_place(wait), str(wait.kind), *on, moment, wait.start,
                None if wait.end == inf else wait.end,
            )  # fmt: skip


def _place(wait: Wait) -> tuple[str | None, str | None, int | None]:
    """Module, resource and delivery: of the handler that waits, or where a message is queued."""
    record = wait.record.by if isinstance(wait.record, HandlerWait) else wait.record
    if isinstance(record, Handling | Queueing):
        return record.module or None, record.resource or None, getattr(record, "delivery", 0) or None
    return record if isinstance(record, str) else None, None, None


def _claims(run: Run) -> Iterator[Row]:
    for claim in run.claims.values():
        yield (
            claim.id, claim.module, claim.resource, claim.is_reserved, claim.sender, claim.origin or None, claim.start,
            claim.granted, claim.end, claim.ended or None,
        )  # fmt: skip


def _json(body: bytes) -> str | None:
    data = plain_data(body)
    return None if data is None else json.dumps(data)


_INT, _SECONDS, _TEXT, _FLAG, _JSON = Kind.INTEGER, Kind.SECONDS, Kind.TEXT, Kind.FLAG, Kind.JSON

TABLES = (
    Table(
        "run",
        {
            "epoch": _TEXT, "began": _SECONDS, "first": _SECONDS, "last": _SECONDS, "until": _SECONDS, "live": _FLAG,
            "entries": _INT,
        },
        _run,
    ),
    Table(
        "messages",
        {
            "id": _INT, "name": _TEXT, "class": _TEXT, "sender": _TEXT, "origin": _INT, "role": _TEXT, "about": _INT,
            "sent": _SECONDS, "started": _SECONDS, "ended": _SECONDS, "answered": _SECONDS, "handlings": _INT,
            "failure": _TEXT, "handled": _FLAG, "dropped": _TEXT, "data": _JSON, "result": _JSON, "failure_data": _JSON,
        },
        _messages,
    ),
    Table(
        "tasks",
        {
            "id": _INT, "name": _TEXT, "parent": _INT, "depth": _INT, "state": _TEXT,
            **{describe_moments(moment)[0].replace(" ", "_"): _SECONDS for moment in MOMENTS},
            "killed": _TEXT, "killed_by": _TEXT, "killed_from": _INT, "killed_for": _INT, "suspended": _FLAG,
        },
        _tasks,
    ),
    Table("states", {"task": _INT, "name": _TEXT, "state": _TEXT, "start": _SECONDS, "end": _SECONDS}, _states),
    Table(
        "handlings",
        {
            "message": _INT, "delivery": _INT, "name": _TEXT, "module": _TEXT, "resource": _TEXT, "start": _SECONDS,
            "end": _SECONDS, "outcome": _TEXT, "handled": _FLAG, "direct_from": _TEXT,
            "slot": _INT, "nested": _FLAG, "priority": _INT,
        },
        _handlings,
    ),
    Table(
        "failures",
        {
            "message": _INT, "name": _TEXT, "time": _SECONDS, "failure": _TEXT, "text": _TEXT, "raised_by": _TEXT,
            "raised_from": _INT,
            "fate": _TEXT, "handled": _FLAG,
        },
        _failures,
    ),
    Table(
        "queueings",
        {
            "message": _INT, "name": _TEXT, "module": _TEXT, "resource": _TEXT, "priority": _INT, "start": _SECONDS,
            "end": _SECONDS,
        },
        _queueings,
    ),
    Table(
        "waits",
        {
            "message": _INT, "module": _TEXT, "resource": _TEXT, "delivery": _INT, "kind": _TEXT, "on": _INT,
            "name": _TEXT, "moment": _TEXT, "start": _SECONDS, "end": _SECONDS,
        },
        _waits,
    ),
    Table(
        "claims",
        {
            "id": _INT, "module": _TEXT, "resource": _TEXT, "reservation": _FLAG, "sender": _TEXT, "origin": _INT,
            "asked": _SECONDS, "granted": _SECONDS, "end": _SECONDS, "why": _TEXT,
        },
        _claims,
    ),
)  # fmt: skip
"""All of them."""


def batches(table: Table, run: Run, size: int) -> Iterator[list[Row]]:
    """The rows of a table, *size* at a time."""
    rows: list[Row] = []
    for row in table.rows(run):
        rows.append(row)
        if len(rows) == size:
            yield rows
            rows = []
    if rows:
        yield rows
