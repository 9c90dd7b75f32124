"""``tca stats``: counts, times and shares of a run or of a part of it."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from central.test_prefetched_messages import Ears, trust_every_handler
from click.testing import CliRunner, Result
from hypothesis import given
from hypothesis import strategies as st
from tools.runs import OPENED
from tools.story import Story, silent_for, walking

from tca_tools.journal.fold import History
from tca_tools.stats.__main__ import SORTS, stats
from tca_tools.stats.measure import Times, measure
from tca_wire.journal import facts
from tca_wire.vocabulary import MessageClass


def shown(*arguments: object, **environment: str) -> Result:
    return CliRunner(env={"COLUMNS": "100"} | environment).invoke(
        stats, [str(argument) for argument in arguments]
    )


def test_stats_tables_match_their_transcript(run: Path, expect: Callable[[str, str], None]) -> None:
    result = shown(run)
    assert result.exit_code == 0
    expect("stats_stumbling", result.stdout)


def test_stats_json_matches_its_transcript(
    run: Path, tmp_path: Path, expect: Callable[[str, str], None]
) -> None:
    asked = [
        shown(run, "--json"),
        shown(run, "--from", 1.0, "--to", 2.0, "--json"),
        shown(walking().write(tmp_path / "walk"), "--json"),
        shown(Story().write(tmp_path / "quiet"), "--json"),
    ]
    expect("stats_json", "\n".join(_rounded(json.loads(one.stdout)) for one in asked) + "\n")


def _rounded(measured: dict[str, Any]) -> str:
    """One line for each message and resource, with rounded times."""
    rows = [{key: value for key, value in measured.items() if not isinstance(value, list)}]
    text = "\n".join(map(json.dumps, [*rows, *measured["messages"], *measured["resources"]]))
    return re.sub(r"\d+\.\d{6,}", lambda number: f"{float(number[0]):.6g}", text)


@pytest.mark.parametrize("width", [12, 33, 60, 79, 160])
def test_stats_lines_fit_the_terminal(run: Path, width: int) -> None:
    lines = shown(run, COLUMNS=str(width)).stdout.splitlines()
    assert max(map(len, lines)) <= width
    assert [
        line for line in lines if line.startswith("tak") and " 3" in line
    ]  # the row of take steps, sent 3 times


def test_narrow_terminal_leaves_out_whole_columns(run: Path) -> None:
    wide, *narrow = (
        [line.split() for line in shown(run, COLUMNS=str(width)).stdout.splitlines()]
        for width in (120, 34)
    )
    heads, figures = narrow[0][2], next(line for line in narrow[0] if line[:2] == ["take", "steps"])
    assert heads == ["message", "sent", "p99", "p99"]
    assert figures == ["take", "steps", "3", "800", "ms", "-"]
    assert next(line for line in wide if line[:2] == ["take", "steps"])[:3] == figures[:3]


def test_stats_of_a_quiet_live_run_last_until_now(tmp_path: Path) -> None:
    run = walking().write(tmp_path / "run")
    with silent_for(run, 60.0):
        live, until, plain = (
            shown(run, *more).stdout for more in ((), ("--to", 30.0), ("--json",))
        )
    assert re.match(
        r"run: 0\.00 to 6\d\.\d\d s \(still running\), 8 tasks \(7 open\), 2 other messages", live
    )
    assert until.startswith("run: 0.00 to 30.00 s, 8 tasks (7 open), 2 other messages")
    measured = json.loads(plain)
    assert measured["live"]
    assert 60 < measured["to"] < 80
    assert not json.loads(shown(run, "--json").stdout)["live"]


def test_prefetched_messages_of_a_lost_module_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    trust_every_handler(monkeypatch)
    player = Ears.of("ear: inform note, query where", "user")
    for message in ("note", "where", "note", "where"):
        player.send("user", message)
    player.lose("ear/1")
    measured = measure(History.until([OPENED, *player.entries])).messages
    assert {one.message: (one.failed, one.open, one.handled) for one in measured} == {
        "note": (2, 0, 1),
        "where": (2, 0, 0),
    }


def test_open_and_dropped_messages_have_columns_and_marks(tmp_path: Path) -> None:
    story = Story().module("legs").at(1.0)
    dances = [story.received("dance", MessageClass.INFORM, "user") for _ in range(3)]
    for dance in dances:
        story.queued(dance)
    run = (
        story.say(facts.Dropped(dances[0], "any", "a newer one came"))
        .at(61.0)
        .write(tmp_path / "run")
    )
    text = shown(run).stdout
    lines = [line.split() for line in text.splitlines()]
    heads, figures = (
        next(line for line in lines if line[:1] == [name]) for name in ("message", "dance")
    )
    assert dict(zip(heads[1:], figures[1:], strict=True)) == {
        "sent": "3",
        "/s": "0.049",
        "open": "2",
        "dropped": "1",
    }
    waited = next(line for line in lines if line[:2] == ["(no", "handler)"])
    assert waited[-9:] == ["3", "2", "60", "s+", "60", "s+", "60", "s+", "2"]
    assert text.endswith("+: at least; some still wait\n")
    queued = json.loads(shown(run, "--json").stdout)["messages"][0]["queued"]
    assert (queued["count"], queued["open"], queued["max"]) == (3, 2, 60.0)


def test_stats_refuse_a_start_after_the_end(run: Path) -> None:
    result = shown(run, "--from", 7)
    assert result.exit_code == 2
    assert "7 is not before the end, 5" in result.stderr


def test_sort_option_orders_the_messages(run: Path) -> None:
    keys: dict[str, Callable[[Any], Any]] = {
        "name": lambda one: one["message"],
        "failed": lambda one: -one["failed"],
        "start": lambda one: -(one["to_start"]["p99"] or 0),
        "busy": lambda one: -one["handling"]["total"],
    }
    assert {*keys} < {"name", *SORTS}
    for sort, key in keys.items():
        messages = json.loads(shown(run, "--json", "--sort", sort).stdout)["messages"]
        assert messages == sorted(messages, key=key)


def test_stats_escape_control_characters_in_names(tmp_path: Path) -> None:
    story = Story().module("legs\x1b[31m", "walk").at(1.0)
    story.received("walk\x07\n", MessageClass.INFORM, "x")
    assert not {"\x1b", "\x07"} & set(shown(story.at(2.0).write(tmp_path / "run")).stdout)


def test_percentile_is_a_lower_bound_while_waits_are_open() -> None:
    queued = Times([1.0, 60.0, 60.0], [60.0, 60.0])
    assert [queued.is_at_least(second) for second in (1.0, 60.0)] == [False, True]


@given(st.lists(st.floats(0, 1e6), min_size=1), st.integers(1, 100))
def test_percentiles_are_exact(seconds: list[float], share: int) -> None:
    times = Times(sorted(seconds))
    found = times.percentile(share)
    assert found in seconds
    assert sum(one <= found for one in seconds) * 100 >= share * len(seconds)
    assert sum(one < found for one in seconds) * 100 < share * len(seconds)
