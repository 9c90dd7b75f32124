"""An MCAP file, read back by the real reader. Its schemas must be readable by viewers."""

import io
import json
from pathlib import Path
from typing import Any

import msgspec
import pytest
from mcap.reader import make_reader
from tools.story import Story, made, stumbling, walking

from tca_tools.export.mcap_file import write_mcap
from tca_tools.export.schemas import object_schema, plain_schema
from tca_wire.journal import facts
from tca_wire.messages.schemas import schema_text
from tca_wire.points import TaskId
from tca_wire.vocabulary import MessageClass, Party

SECOND = 1_000_000_000
BEGAN = 1_700_000_000 * SECOND


class Topic:
    """A topic as the reader returns it."""

    def __init__(self) -> None:
        self.schema: dict[str, Any] = {}
        self.schema_name = ""
        self.message = ""
        self.times: list[float] = []
        self.contents: list[dict[str, Any]] = []


def topics_of(story: Story) -> dict[str, Topic]:
    stream = io.BytesIO()
    write_mcap(story.fold(), story.entries, stream)
    topics: dict[str, Topic] = {}
    last = 0
    for schema, channel, message in make_reader(
        io.BytesIO(stream.getvalue()), validate_crcs=True
    ).iter_messages(log_time_order=False):
        assert schema is not None
        assert message.log_time >= last, "messages are in the order of time"
        last = message.log_time
        assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
        topic = topics.setdefault(channel.topic, Topic())
        topic.schema, topic.schema_name = json.loads(schema.data), schema.name
        topic.message = channel.metadata.get("message", "")
        topic.times.append((message.log_time - BEGAN) / SECOND)
        topic.contents.append(json.loads(message.data))
        assert message.sequence == len(topic.contents)
    for topic in topics.values():
        assert_readable(topic.schema)
        for content in topic.contents:
            assert_fits(topic.schema, content)
    return topics


def assert_readable(schema: dict[str, Any]) -> None:
    """Check for the only forms that Foxglove accepts (foxglove/studio, parseJsonSchema.ts)."""
    assert schema["type"] == "object"
    for field in schema["properties"].values():
        assert "oneOf" not in field
        inner = field["items"] if field["type"] == "array" else field
        assert inner["type"] in ("boolean", "string", "number", "integer", "object")
        if inner["type"] == "object":
            assert_readable(inner)
        assert inner is field or "contentEncoding" not in inner
        assert inner.get("contentEncoding", "base64") == "base64"


def assert_fits(schema: dict[str, Any], value: Any) -> None:
    """Check a value against its schema."""
    kinds: dict[str, Any] = {
        "boolean": bool,
        "string": str,
        "number": (int, float),
        "integer": int,
        "object": dict,
        "array": list,
    }
    assert isinstance(value, kinds[schema["type"]]), (schema, value)
    assert value in schema.get("enum", [value])
    if schema["type"] == "array":
        for item in value:
            assert_fits(schema["items"], item)
    if schema["type"] == "object":
        for name in value.keys() & schema["properties"].keys():
            assert_fits(schema["properties"][name], value[name])


class Foot(msgspec.Struct):
    leg: int
    x: float


class Stance(msgspec.Struct):
    feet: list[Foot]
    name: str | None = None
    heights: bytes = b""


def declared(story: Story, message: str, kind: MessageClass, data: Any, reply: Any = None) -> Story:
    return story.say(facts.FormatDefined(message, kind, schema_text(data), schema_text(reply), "x"))


def test_topic_of_a_message_has_the_schema_of_its_data() -> None:
    story = declared(
        Story().module("legs", "move leg"), "move leg", MessageClass.GOAL, Stance, reply=Foot
    )
    move = story.at(1.5).goal(
        "move leg", "user", data=Stance([Foot(2, 0.5)], heights=b"\x01\x02"), to="legs"
    )
    story.at(2.5).returned(move, data=Foot(2, 0.75))
    topics = topics_of(story)
    sent, result = topics["/messages/move_leg"], topics["/results/move_leg"]
    assert (sent.message, sent.schema_name, sent.times) == ("move leg", "move leg", [1.5])
    data = {"feet": [{"leg": 2, "x": 0.5}], "heights": {"base64": "AQI="}}
    assert sent.contents == [{"id": 1, "sender": "user", "parent": 0, "origin": 0, "data": data}]
    assert sent.schema["properties"]["data"]["properties"]["feet"]["items"]["properties"]["x"] == {
        "type": "number"
    }
    assert (result.times, result.contents) == ([2.5], [{"id": 1, "data": {"leg": 2, "x": 0.75}}])
    assert result.schema["properties"]["data"]["properties"]["leg"] == {"type": "integer"}


def test_similar_message_names_get_distinct_topics() -> None:
    story = Story().at(1.0)
    for name in ("move leg", "move_leg", "move!leg"):
        story.goal(name, "user")
    topics = topics_of(story)
    assert [
        (name, topic.message) for name, topic in topics.items() if name.startswith("/messages")
    ] == [
        ("/messages/move_leg", "move leg"),
        ("/messages/move_leg_2", "move_leg"),
        ("/messages/move_leg_3", "move!leg"),
    ]


def test_task_and_resource_topics_follow_their_states() -> None:
    topics = topics_of(stumbling())
    states = [(content["id"], content["state"]) for content in topics["/tca/tasks"].contents]
    assert [state for task, state in states if task == 7] == ["held", "handling", "failed"]
    failed = next(
        content for content in topics["/tca/tasks"].contents if content["state"] == "failed"
    )
    assert failed["failure"].startswith("terrain collision: ")
    planner = [
        content
        for content in topics["/tca/resources"].contents
        if content["resource"] == "gait planner"
    ]
    assert [(content["running"], content["queued"]) for content in planner][-1] == (0, 0)
    assert max(content["queued"] for content in planner) == 2
    assert all(content["running"] >= 0 for content in planner)


@pytest.mark.parametrize("top_fails", [False, True])
def test_failure_tells_whether_it_was_handled(*, top_fails: bool) -> None:
    topics = topics_of(made("not_replaced" if top_fails else "replaced"))
    handled = [row["handled"] for row in topics["/tca/tasks"].contents if row["failure"]]
    assert set(handled) == {not top_fails}
    assert all("handled" not in row for row in topics["/tca/tasks"].contents if not row["failure"])
    levels = [
        row["level"] for row in topics["/tca/log"].contents if row["message"].startswith("failed: ")
    ]
    assert levels == [4 if top_fails else 3]  # Foxglove's error, or warning


def test_each_fact_is_a_row_and_a_log_message() -> None:
    story = stumbling()
    topics = topics_of(story)
    number = sum(len(entry.facts) for entry in story.entries)
    assert len(topics["/tca/facts"].contents) == len(topics["/tca/log"].contents) == number
    assert topics["/tca/log"].schema_name == "foxglove.Log"
    errors = [content for content in topics["/tca/log"].contents if content["level"] == 4]
    assert errors[0]["timestamp"] == {"sec": 1_700_000_004, "nsec": 500_000_000}
    assert errors[0]["message"].startswith("failed: move body {7}")
    assert topics["/tca/facts"].contents[0]["kind"] == "opened"


def test_progress_of_a_task_has_a_topic() -> None:
    story = Story().module("arm", "grasp").at(1.0)
    grasp = TaskId(story.command("grasp", "planner", to="arm"))
    for force in (2, 3):
        body = msgspec.msgpack.encode({"force": force})
        step = facts.StateChanged(
            grasp, "result available", "running", force, Party.SERVER, "arm", "", body
        )
        story.at(float(force)).say(step)
    topic = topics_of(story)["/progress/grasp"]
    assert (topic.times, [one["data"]["force"] for one in topic.contents]) == ([2.0, 3.0], [2, 3])


def test_entries_of_equal_time_keep_their_order() -> None:
    story = Story()
    for _ in range(3):
        story.at(1.0).received("note", MessageClass.INFORM, "x")
    assert topics_of(story)["/messages/note"].times == pytest.approx([1.0, 1.0, 1.0])
    assert [content["id"] for content in topics_of(story)["/messages/note"].contents] == [1, 2, 3]


def test_mcap_reader_finds_topics_times_and_metadata(tmp_path: Path) -> None:
    story, path = walking(), tmp_path / "run.mcap"
    with path.open("wb") as stream:
        write_mcap(story.fold(), story.entries, stream)
    with path.open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert {channel.topic for channel in summary.channels.values()} >= {
            "/messages/take_steps",
            "/tca/tasks",
        }
        assert (
            summary.statistics.message_start_time - BEGAN,
            summary.statistics.message_end_time - BEGAN,
        ) == (
            0,
            int(3.4 * SECOND),
        )
        found = list(reader.iter_messages(topics=["/messages/move_leg"]))
        assert [message.log_time - BEGAN for _, _, message in found] == [
            int(1.4 * SECOND),
            int(2.2 * SECOND),
        ]
        assert {metadata.name: metadata.metadata for metadata in reader.iter_metadata()} == {
            "tca": {"epoch": "epoch", "began": "1700000000.0"}
        }


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        (None, None),
        (float, {"type": "number"}),
        (int | None, {"type": "integer"}),
        (int | str, None),
        (list[float], {"type": "array", "items": {"type": "number"}}),
        (list[float | None], None),
        (list[list[float]], None),
        (tuple[float, float], {"type": "array", "items": {"type": "number"}}),
        (tuple[float, str], None),
        (dict[str, int], {"type": "object", "properties": {}}),
        (
            Foot,
            {"type": "object", "properties": {"leg": {"type": "integer"}, "x": {"type": "number"}}},
        ),
        (bytes, object_schema("bytes", base64={"type": "string", "contentEncoding": "base64"})),
        (Any, None),
    ],
)
def test_plain_schema_reduces_each_type_for_viewers(kind: Any, expected: Any) -> None:
    assert plain_schema(schema_text(kind)) == expected


class Node(msgspec.Struct):
    value: int
    below: "Node | None" = None


def test_plain_schema_accepts_recursive_and_invalid_schemas() -> None:
    assert plain_schema(schema_text(Node)) == {
        "type": "object",
        "properties": {"value": {"type": "integer"}},
    }
    assert plain_schema("") is None
    assert plain_schema("no JSON") is None
    assert plain_schema("[1, 2]") is None
    assert plain_schema('{"$ref": "#/$defs/nobody"}') is None
    assert plain_schema('{"type": "object", "properties": 5, "$defs": 5}') == {
        "type": "object",
        "properties": {},
    }


def test_plain_schema_of_exponential_references_stays_small() -> None:
    below = {
        f"T{n}": {
            "type": "object",
            "properties": {c: {"$ref": f"#/$defs/T{n + 1}"} for c in "abcd"},
        }
        for n in range(30)
    }
    plain = plain_schema(
        json.dumps({"$ref": "#/$defs/T0", "$defs": below | {"T30": {"type": "number"}}})
    )
    assert len(json.dumps(plain)) < 1_000_000


@pytest.mark.parametrize(
    ("shape", "encoding"),
    [
        ((3, 4), "mono8"),
        ((1, 4, 3), "rgb8"),
        ((1, 3, 4), "rgba8"),
        ((12,), ""),
        ((3, 2, 2), ""),
        ((3, 5), ""),
        ((-3, -4), ""),
        ((2, 2, 1, 3), ""),
    ],
)
def test_array_of_bytes_is_an_image_by_its_shape(shape: tuple[int, ...], encoding: str) -> None:
    content = msgspec.msgpack.encode(["|u1", shape, bytes(12)])
    story = Story().module("map", "note")
    story.received("note", MessageClass.INFORM, "user", data={"a": msgspec.msgpack.Ext(1, content)})
    topic = topics_of(story).get("/images/messages/note/a")
    assert (topic.contents[0]["encoding"] if topic else "") == encoding
