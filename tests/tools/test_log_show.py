import datetime as dt
import itertools
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest
from click.testing import Result
from tools.runs import encoded, walk
from tools.story import Story, made, stumbling

from tca_tools.log.__main__ import KINDS
from tca_tools.log.classic import classic_lines
from tca_wire.journal import facts
from tca_wire.text.bodies import data_text, plain_data
from tca_wire.vocabulary import MessageClass, Outcome

Tca = Callable[..., Result]


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return stumbling().write(tmp_path / "run", segments=2)


def test_log_has_a_line_for_each_fact(
    tca: Tca, run: Path, expect: Callable[[str, str], None]
) -> None:
    result = tca("log", "show", run)
    assert result.exit_code == 0
    expect("log_stumbling", result.stdout)


def test_every_kind_of_fact_has_words(
    tca: Tca, tmp_path: Path, expect: Callable[[str, str], None]
) -> None:
    story = made("every_kind")
    assert {facts.kind_of(fact) for entry in story.entries for fact in entry.facts} == set(KINDS)
    expect("log_every_kind", tca("log", "show", story.write(tmp_path / "run")).stdout)


def test_log_lines_are_cut_to_the_terminal(tca: Tca, run: Path) -> None:
    whole = tca("log", "show", run).stdout.splitlines()
    narrow = tca("log", "show", run, COLUMNS="60").stdout.splitlines()
    assert max(map(len, narrow)) == 60
    assert [line if len(line) <= 60 else line[:59] + "…" for line in whole] == narrow


def test_json_log_has_a_line_for_each_fact(tca: Tca, tmp_path: Path) -> None:
    result = tca("log", "show", made("every_kind").write(tmp_path / "run"), "--json")
    rows = [json.loads(line) for line in result.stdout.splitlines()]
    assert {row["kind"] for row in rows} == set(KINDS)
    first = next(row for row in rows if row["kind"] == "received")
    assert first.pop("cause")["message"] == "Send"
    assert first == {
        "t": 0.0,
        "entry": 1,
        "kind": "received",
        "id": 1,
        "message": "walk",
        "message_class": "goal",
        "sender": "script",
        "parent": 0,
        "origin": 0,
        "blocking": False,
        "constraints": [],
        "role": "",
        "about": 0,
        "data": {"metres": 2.5},
    }


def test_log_shows_the_cause_of_each_entry(tca: Tca, tmp_path: Path) -> None:
    path = tmp_path / "walk.tcaj"
    path.write_bytes(encoded(walk()))
    lines = tca("log", "show", path).stdout.splitlines()
    assert any(line.endswith("(Send by planner, in the handler of walk {3})") for line in lines)
    assert any(line.endswith("(end of a delay of look {6})") for line in lines)
    rows = [json.loads(line) for line in tca("log", "show", path, "--json").stdout.splitlines()]
    asked = next(row for row in rows if row["kind"] == "received" and row["message"] == "step")
    assert (asked["cause"]["kind"], asked["cause"]["message"], asked["cause"]["origin"]) == (
        "request",
        "Send",
        3,
    )


def test_log_task_option_accepts_number_or_name(tca: Tca, run: Path) -> None:
    by_number = tca("log", "show", run, "--task", 3).stdout
    assert tca("log", "show", run, "--task", "{3}").stdout == by_number
    all_steps = tca("log", "show", run, "--task", "take steps").stdout.splitlines()
    each = [tca("log", "show", run, "--task", number).stdout.splitlines() for number in (2, 3, 4)]
    # a cause is on the first shown line of its entry
    each_line = [line for lines in each for line in lines]
    without_causes = [
        {line.partition("  (")[0] for line in lines} for lines in (all_steps, each_line)
    ]
    assert without_causes[0] == without_causes[1]
    maps = tca(
        "log", "show", run, "--task", "elevation map", "--kind", "returned"
    ).stdout  # also the name of a query
    assert [line.split()[2:4] for line in maps.splitlines()] == [["elevation", "map"]] * 2


def test_log_of_a_message_includes_all_its_deliveries(tca: Tca, tmp_path: Path) -> None:
    story = Story().module("guard").module("arm", "status").module("legs", "status")
    status = story.received("status", MessageClass.MULTI_QUERY, "guard")
    copies = [facts.Delivered(70, status, "arm", "arm"), facts.Queued(71, status, "legs", "legs")]
    story.at(1.0).say(
        *copies, facts.Returned(70, Outcome.DONE, msgspec.msgpack.encode(1)), facts.Unqueued(71)
    )
    run = story.write(tmp_path / "run")
    for task in ("1", "status"):
        lines = tca("log", "show", run, "--task", task).stdout.splitlines()
        kinds = [line.split()[1] for line in lines if line.startswith("     1")]
        assert kinds == ["delivered", "queued", "returned", "unqueued"]


@pytest.mark.parametrize("task", ["99999", "take stpes", ""])
def test_log_refuses_an_unknown_task_like_tree(tca: Tca, run: Path, task: str) -> None:
    result = tca("log", "show", run, "--task", task)
    assert (result.exit_code, result.stdout) == (1, "")
    assert f"no task '{task}' in this journal" in result.stderr
    assert result.stderr == tca("tree", run, "--task", task).stderr
    assert (
        tca("log", "show", run, "--task", 2, "--kind", "opened").exit_code == 0
    )  # the task exists, without a fact of that kind


def test_log_kind_option_filters_and_text_is_printable(tca: Tca, run: Path) -> None:
    line = tca("log", "show", run, "--kind", "failed").stdout
    assert line.split()[1] == "failed"
    assert tca("log", "show", run, "--kind", "fialed").exit_code == 2
    assert line.rstrip("\n").isprintable()
    assert r"leg 4 met\x1b[31m rock" in line


def test_log_follow_shows_the_journal_and_ends_on_interrupt(
    tca: Tca, run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(_seconds: float) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(time, "sleep", interrupt)
    result = tca("log", "show", run, "--follow")
    assert result.exit_code == 1
    assert result.stdout == tca("log", "show", run).stdout
    assert "Traceback" not in result.stderr


@pytest.mark.parametrize(
    ("value", "text"),
    [
        ({"radius": 5.0, "leg": None}, '{"radius": 5.0, "leg": null}'),
        ({1: True, "list": [1, "é"]}, '{"1": true, "list": [1, "é"]}'),
        (b"\x00\xff", '{"base64": "AP8="}'),
        (msgspec.msgpack.Ext(9, b"\x01"), '{"extension": 9, "base64": "AQ=="}'),
        (dt.datetime(2025, 1, 2, tzinfo=dt.UTC), '"2025-01-02T00:00:00+00:00"'),
        ([float("nan"), float("-inf")], '["nan", "-inf"]'),
        ("\x1b[2J", r'"\u001b[2J"'),
        ("\u202e", r'"\u202e"'),
    ],
)
def test_data_text_is_json_for_each_type(value: Any, text: str) -> None:
    assert data_text(msgspec.msgpack.encode(value)) == text


def test_array_is_shown_by_dtype_and_shape() -> None:
    array = msgspec.msgpack.Ext(1, msgspec.msgpack.encode(["<f8", (2, 3), bytes(48)]))
    assert plain_data(msgspec.msgpack.encode({"map": array})) == {
        "map": {"dtype": "<f8", "shape": [2, 3], "bytes": 48}
    }


@pytest.mark.parametrize(
    ("dtype", "shape", "words"),
    [
        ("|u1", (480, 640, 3), "uint8 array of 480 x 640 x 3 (48 bytes)"),
        ("<f8", (6,), "float64 array of 6 (48 bytes)"),
        ("<f4", (), "float32 array (48 bytes)"),
        ("|b1", (2, 24), "bool array of 2 x 24 (48 bytes)"),
        ("<M8[ns]", (6,), "<M8[ns] array of 6 (48 bytes)"),
        ([["x", "<f8"]], (6,), "structured array of 6 (48 bytes)"),
        ("", (), "data of 48 bytes"),
    ],
)
def test_array_is_shown_in_words(dtype: Any, shape: tuple[int, ...], words: str) -> None:
    array = msgspec.msgpack.Ext(1, msgspec.msgpack.encode([dtype, shape, bytes(48)]))
    assert data_text(msgspec.msgpack.encode(array)) == f'"{words}"'
    assert data_text(msgspec.msgpack.encode({"map": [array]})) == f'{{"map": ["{words}"]}}'


def test_data_text_accepts_empty_malformed_long_and_deep_data() -> None:
    assert data_text(b"") == data_text(b"\xc0") == ""
    assert (
        data_text(b"\xc1")
        == '{"undecodable": "1 bytes: a large body is damaged: Input data was truncated"}'
    )
    assert len(data_text(msgspec.msgpack.encode("x" * 100_000))) < 3_000
    deep: Any = 1
    for _ in itertools.repeat(None, 200):
        deep = [deep]
    assert "…" in data_text(msgspec.msgpack.encode(deep))


def test_dropped_delivery_names_its_message(tca: Tca, tmp_path: Path) -> None:
    story = Story().module("map", "pose")
    pose = story.received("pose", MessageClass.VARIABLE, "legs")
    story.say(
        facts.Queued(9, pose, "map", "map"), facts.Dropped(9, "pose", "a newer one came", pose)
    )
    assert (
        f"dropped        pose {{9}} of message {{{pose}}}: a newer one came"
        in tca("log", "show", story.write(tmp_path / "run")).stdout
    )


def test_json_log_has_constraints_as_points(tca: Tca, run: Path) -> None:
    rows = map(
        json.loads,
        tca("log", "show", run, "--json", "--task", 3, "--kind", "received").stdout.splitlines(),
    )
    assert next(row for row in rows if row["id"] == 3)["constraints"] == [
        {
            "before": {"task": 2, "moment": "end achieving"},
            "after": {"task": 3, "moment": "start achieving"},
        }
    ]


def test_classic_logs_match_their_transcripts(expect: Callable[[str, str], None]) -> None:
    expect("classic_stumbling", "\n".join(classic_lines(stumbling().entries)) + "\n")
    expect("classic_walk", "\n".join(classic_lines(walk())) + "\n")
    for start in range(1, len(walk()) - 20, 5):  # from any entry on
        assert list(classic_lines(walk()[start:]))


def test_classic_log_indents_data_and_cuts_after_five_lines() -> None:
    story = Story().module("user").module("map", "note")
    note = story.received("note", MessageClass.INFORM, "user", data={"text": "a word " * 100})
    story.say(facts.Delivered(note, note, "map", "map"), facts.Returned(note, Outcome.DONE, b""))
    lines = list(classic_lines(story.entries))
    data = [line for line in lines if line.startswith("    ")]
    assert len(data) == 6
    assert data[-1] == "    ..."
    assert max(map(len, data)) <= 80
    assert lines[-1].split()[:3] == ["Done", "note", "{1}:"]


def test_classic_option_prints_the_classic_log(tca: Tca, tmp_path: Path) -> None:
    path = tmp_path / "walk.tcaj"
    path.write_bytes(encoded(walk()))
    assert tca("log", "show", path, "--classic").stdout.splitlines() == list(classic_lines(walk()))
    refused = tca("log", "show", path, "--classic", "--json")
    assert (refused.exit_code, "leave out --json" in refused.stderr) == (2, True)
