"""A run as an MCAP file: JSON messages on topics with JSON Schemas (see docs/tools/exports.md)."""

import heapq
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from itertools import count
from operator import itemgetter
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import msgspec
from mcap.writer import Writer

from tca_tools.export.images import RAW_IMAGE, TIME, images_in, with_kept_data
from tca_tools.export.nanoseconds import Nanoseconds, since_1970
from tca_tools.export.schemas import Schema, object_schema, plain_schema
from tca_tools.journal.at_time import TaskAt
from tca_tools.journal.fates import run_continued
from tca_tools.journal.lives import effect_of
from tca_tools.journal.whole_run import Run
from tca_tools.log.fact_rows import BAD_NEWS, fact_row
from tca_wire.journal import facts
from tca_wire.journal.facts import Entry, kind_of
from tca_wire.life_cycles import Effect
from tca_wire.text.bodies import plain_data
from tca_wire.text.facts_in_words import Wording, place
from tca_wire.text.measures import run_time
from tca_wire.vocabulary import Outcome

_SECOND = 1_000_000_000
_IMAGES = "/images"
_INFO, _WARNING, _ERROR = 2, 3, 4
"""Levels of Foxglove's log."""
_LEVELS = dict.fromkeys(BAD_NEWS, _WARNING) | {"failed": _ERROR}

_TEXT, _INT, _NUMBER, _FLAG = (
    {"type": kind} for kind in ("string", "integer", "number", "boolean")
)
_CAUSE = object_schema(
    "cause",
    kind=_TEXT,
    module=_TEXT,
    connection=_INT,
    number=_INT,
    message=_TEXT,
    origin=_INT,
    due=_TEXT,
    about=_INT,
)
_SCHEMAS = {
    "/tca/facts": object_schema("tca.Fact", t=_NUMBER, entry=_INT, cause=_CAUSE, kind=_TEXT),
    "/tca/tasks": object_schema(
        "tca.Task",
        id=_INT,
        name=_TEXT,
        parent=_INT,
        sender=_TEXT,
        state=_TEXT,
        failure=_TEXT,
        handled=_FLAG,
    ),
    "/tca/resources": object_schema("tca.Resource", resource=_TEXT, running=_INT, queued=_INT),
    "/tca/log": object_schema(
        "foxglove.Log",
        timestamp=TIME,
        level=_INT,
        message=_TEXT,
        name=_TEXT,
        file=_TEXT,
        line=_INT,
    ),
}
"""By topic: its schema. The schemas of the robot's messages come from their declarations."""


class TopicMessage(NamedTuple):
    """A message on a topic; *about* is the name of the robot's message, or "".

    The name of an image's field follows the name of its message.
    """

    time: int
    topic: str
    about: str
    content: dict[str, Any]


def write_mcap(
    run: Run, entries: Iterable[Entry], stream: BinaryIO, kept: Path | None = None
) -> None:
    """Write a run as MCAP.

    Args:
        run: The run.
        entries: The entries from which the run was built.
        stream: The file.
        kept: The folder with its large data; without it they are described.
    """
    writer = _Topics(run, stream)
    nanoseconds = Nanoseconds(run)
    streams = (
        _from_entries(run, entries, nanoseconds, kept),
        _states(run, nanoseconds),
        _resources(run, nanoseconds),
    )
    for message in heapq.merge(*streams, key=itemgetter(0)):
        writer.write(message)
    writer.finish()


# --- records --------------------------------------------------------------------------------------


def _from_entries(
    run: Run, entries: Iterable[Entry], nanoseconds: Nanoseconds, kept: Path | None
) -> Iterator[TopicMessage]:
    """Yield the lines of the log, facts, messages, results and images."""
    wording, began, place_in_run, time = Wording(), since_1970(run), -1, 0
    for entry in entries:
        if place_in_run < 0 or entry.number != run.numbers[place_in_run]:
            place_in_run += 1  # an event may have several entries of one number
            time = nanoseconds(run.times[place_in_run])
        for fact in entry.facts:
            kind = kind_of(fact)
            level = _LEVELS.get(kind, _INFO)
            if isinstance(fact, facts.Failed) and _is_handled(run, fact, run.times[place_in_run]):
                level = _WARNING
            yield _logged(time, began, level, f"{kind}: {wording.words(fact)}", entry.number)
            yield TopicMessage(time, "/tca/facts", "", fact_row(entry, fact))
            yield from _data_of(run, fact, time, kept)
    if run.is_live and run.times:  # the file ends at this time
        text = f"still running: nothing has happened since {run_time(run.times[-1])}"
        yield _logged(max(nanoseconds(run.time), time), began, _INFO, text, run.numbers[-1])


def _data_of(run: Run, fact: facts.Fact, time: int, kept: Path | None) -> Iterator[TopicMessage]:
    """Yield a sent message, a result or an intermediate result with its data, then its images."""
    if isinstance(fact, facts.Received):
        topic, name = "/messages", fact.message
        content: dict[str, Any] = {
            "id": fact.id,
            "sender": fact.sender,
            "parent": fact.parent,
            "origin": fact.origin,
        }
    else:
        if isinstance(fact, facts.Returned) and fact.outcome is Outcome.DONE:
            topic, number, message = "/results", fact.id, run.delivered(fact.id)
        elif isinstance(fact, facts.StateChanged) and (task := run.tasks.get(fact.task)):
            is_result = effect_of(run, task, fact.transition, fact.state) is Effect.RESULT
            topic, number, message = "/progress", fact.task, task if is_result else None
        else:
            return
        if not message:
            return
        name, content = message.name, {"id": number}
    data = plain_data(with_kept_data(fact.body, kept) if kept else fact.body)
    if data is not None:
        content["data"] = _without_none(data)
    elif topic != "/messages":
        return
    yield TopicMessage(time, topic, name, content)
    for where, image in images_in(data, name):
        image["timestamp"] = _timestamp(time + since_1970(run))
        yield TopicMessage(time, f"{_IMAGES}{topic}", where, image)


def _logged(time: int, began: int, level: int, text: str, number: int) -> TopicMessage:
    """Return a line of Foxglove's log; *number* is the number of its entry."""
    line = {
        "timestamp": _timestamp(time + began),
        "level": level,
        "message": text,
        "name": "tca",
        "file": "",
        "line": number,
    }
    return TopicMessage(time, "/tca/log", "", line)


def _timestamp(time: int) -> dict[str, int]:
    return {"sec": time // _SECOND, "nsec": time % _SECOND}


def _is_handled(run: Run, fact: facts.Failed, time: float) -> bool:
    failed = run.delivered(fact.id)
    return failed is not None and run_continued(run, failed, time)


def _without_none(value: Any) -> Any:
    """Return *value* without fields that are None, which plain schemas can't describe."""
    if isinstance(value, dict):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    return [_without_none(item) for item in value] if isinstance(value, list) else value


def _states(run: Run, nanoseconds: Nanoseconds) -> Iterator[TopicMessage]:
    """Yield each change of a task's state."""
    changes = sorted((time, task.id) for task in run.tasks.values() for time, _ in task.states)
    for time, number in changes:
        record = run.tasks[number]
        task = TaskAt(run, record, time)
        content = {"id": number, "name": task.name, "parent": task.parent, "sender": task.sender}
        content |= {"state": str(task.state), "failure": str(task.failure)}
        if task.failure:
            content["handled"] = run_continued(run, record, record.written_at("failure", time))
        yield TopicMessage(nanoseconds(time), "/tca/tasks", "", content)


def _resources(run: Run, nanoseconds: Nanoseconds) -> Iterator[TopicMessage]:
    """Yield the numbers of running handlers and queued messages of a resource at each change."""
    changes = [
        (nanoseconds(time), place(span.module, span.resource) or "(no handler)", is_running, step)
        for is_running, spans in ((True, run.handlings), (False, run.queueings))
        for span in spans
        for time, step in ((span.start, 1), (span.end, -1))
        if time is not None
    ]
    counts: dict[str, list[int]] = {}
    for time, resource, is_running, step in sorted(changes):
        queued_and_running = counts.setdefault(resource, [0, 0])
        queued_and_running[is_running] += step
        queued, running = queued_and_running
        yield TopicMessage(
            time, "/tca/resources", "", {"resource": resource, "running": running, "queued": queued}
        )


# --- the file -------------------------------------------------------------------------------------


class _Topics:
    """Writes messages to topics; the first message of a topic creates it."""

    def __init__(self, run: Run, stream: BinaryIO) -> None:
        self._run = run
        self._began = since_1970(run)
        self._writer = Writer(stream)
        self._writer.start(profile="", library="tca")
        self._writer.add_metadata("tca", {"epoch": run.epoch, "began": repr(run.began or 0.0)})
        self._channels: dict[tuple[str, str], int] = {}
        self._topics: set[str] = set()
        self._counts: Counter[int] = Counter()

    def write(self, message: TopicMessage) -> None:
        key = (message.topic, message.about)
        if key not in self._channels:
            self._channels[key] = self._open(*key)
        channel = self._channels[key]
        self._counts[channel] += 1
        time = message.time + self._began
        self._writer.add_message(
            channel, time, msgspec.json.encode(message.content), time, self._counts[channel]
        )

    def finish(self) -> None:
        """Write the index at the end of the file."""
        self._writer.finish()  # type: ignore[no-untyped-call]

    def _open(self, topic: str, about: str) -> int:
        schema = _SCHEMAS.get(topic) or self._schema_about(topic, about)
        schema_id = self._writer.register_schema(
            schema["title"], "jsonschema", msgspec.json.encode(schema)
        )
        wanted = name = f"{topic}/{re.sub(r'[^A-Za-z0-9_/-]', '_', about)}" if about else topic
        for number in count(2):  # "move leg" and "move_leg" have different topics
            if name not in self._topics:
                break
            name = f"{wanted}_{number}"
        self._topics.add(name)
        return self._writer.register_channel(
            name, "json", schema_id, {"message": about} if about else {}
        )

    def _schema_about(self, topic: str, about: str) -> Schema:
        """Return the schema of a message's data or result, from its declaration."""
        if topic.startswith(_IMAGES):
            return RAW_IMAGE
        known = self._run.formats.get(about)
        if topic == "/progress":
            return object_schema(f"{about} (progress)", id=_INT)
        if topic == "/results":
            return object_schema(
                f"{about} (result)", id=_INT, data=plain_schema(known.reply) if known else None
            )
        data = plain_schema(known.data) if known else None
        return object_schema(about, id=_INT, sender=_TEXT, parent=_INT, origin=_INT, data=data)
